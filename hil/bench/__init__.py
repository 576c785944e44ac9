# SPDX-License-Identifier: Apache-2.0
"""The real bench: two boards, their probes, serial ports and wires, and who may use them."""
