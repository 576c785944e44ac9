# SPDX-License-Identifier: Apache-2.0
"""Become another program, with standard input as the terminal of its session: ``ARGV...``."""

import fcntl
import os
import sys
import termios

fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.argv[1], sys.argv[1:])
