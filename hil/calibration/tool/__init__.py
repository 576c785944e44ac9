# SPDX-License-Identifier: Apache-2.0
"""The guided calibration of one unit over its serial line: talk to it, lead the person, confirm."""
