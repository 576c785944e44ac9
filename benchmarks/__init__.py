# SPDX-License-Identifier: Apache-2.0
"""How fast it is, beside what a user would take instead: ``make bench``, docs/performance.md."""
