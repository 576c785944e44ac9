# SPDX-License-Identifier: Apache-2.0
"""Become another program, with standard input as the terminal of its session: ``ARGV...``."""

import fcntl
import os
import signal
import sys
import termios

# A shell that starts this in the background ignores Ctrl-C; what is tested should not.
signal.signal(signal.SIGINT, signal.SIG_DFL)
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.argv[1], sys.argv[1:])
