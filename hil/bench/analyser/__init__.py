# SPDX-License-Identifier: Apache-2.0
"""Logic analysers: live captures, captures from files, and what may be believed of them."""
