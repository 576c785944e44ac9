# SPDX-License-Identifier: Apache-2.0
"""The estimate against an outside reference: string pot, video, encoder."""
