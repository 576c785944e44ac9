# SPDX-License-Identifier: Apache-2.0
"""Calibration of one unit: from still samples to a record (docs/calibration.md).

``poses`` judges what is held still, ``solve`` makes a calibration of it, ``record`` keeps it,
``kconfig`` puts it into an image, ``allan`` says how the sensor wanders. Nothing here reads a
port or a clock.
"""
