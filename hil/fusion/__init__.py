# SPDX-License-Identifier: Apache-2.0
"""The leader's estimator in a recording: repeated on the host, and held against the truth."""

from hil.fusion.measures import measure
from hil.fusion.series import series

__all__ = ["measure", "series"]
