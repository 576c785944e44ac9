# SPDX-License-Identifier: Apache-2.0
"""``hil log``: what serial ports say, kept as recordings; the CSV lines in them as tables."""
