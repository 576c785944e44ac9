# SPDX-License-Identifier: Apache-2.0
"""Ours and other trackers on the same samples: who would have served best? docs/estimators.md."""
