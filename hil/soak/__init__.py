# SPDX-License-Identifier: Apache-2.0
"""Long runs: what each hour was like, and whether anything drifts."""
