# SPDX-License-Identifier: Apache-2.0
"""Hardware-in-the-loop rig for the two-node barbell velocity tracker.

Data flows one way: bytes (:mod:`hil.wire`) -> records (:mod:`hil.recording`) ->
measurements (:mod:`hil.timesync`, :mod:`hil.imu`) -> views (:mod:`hil.report`).
"""
