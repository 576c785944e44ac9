# SPDX-License-Identifier: Apache-2.0
"""The simulated bench: two nodes on a simulated radio, their serial lines and their pins."""

from hil.simulator.session import Session

__all__ = ["Session"]
