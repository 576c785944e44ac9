# SPDX-License-Identifier: Apache-2.0
"""What every suite needs of the process it runs in."""

from __future__ import annotations

import signal

# A shell that runs its job in the background has it ignore Ctrl-C, and programs inherit that. The
# tests that interrupt a program must find it as a user at a terminal does. nohup does it to SIGHUP.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
