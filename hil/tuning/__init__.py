# SPDX-License-Identifier: Apache-2.0
"""The estimator with other parameters over recordings: run again, and its thresholds chosen."""
