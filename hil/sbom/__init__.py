# SPDX-License-Identifier: Apache-2.0
"""What the firmware and the rig are made of: parts, revisions, hashes, licences."""
