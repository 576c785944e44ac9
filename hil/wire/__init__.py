# SPDX-License-Identifier: Apache-2.0
"""The wire protocol: the table, the codec between bytes and records, and the C header."""
