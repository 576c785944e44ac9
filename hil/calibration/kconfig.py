# SPDX-License-Identifier: Apache-2.0
"""A calibration as a Kconfig fragment, for an image that holds it as its defaults.

Kconfig has no fractions: biases are in um/s^2 and urad/s, the matrix in parts per million. What
rounding to these leaves is in docs/calibration.md, section 6.
"""

from __future__ import annotations

import numpy as np

from hil.calibration.solve import Calibration, check

_AXES = "XYZ"


def fragment(calibration: Calibration, source: str) -> str:
    """Text of a ``.conf`` file.

    Args:
        source: which record it comes from, for the heading.

    Raises:
        HilError: the calibration is impossible.
    """
    check(calibration)
    # Whatever a file is called, it must not end the comment.
    named = " ".join(source.split())
    lines = [
        "# SPDX-License-Identifier: Apache-2.0",
        f"# Calibration of one unit, from {named}",
        f"# Method {calibration.method}, gravity {calibration.gravity_mps2:.5f} m/s^2.",
    ]
    for axis, value in zip(_AXES, _millionths(calibration.accel_bias_mps2), strict=True):
        lines.append(f"CONFIG_BV_CAL_ACCEL_BIAS_{axis}_UMPS2={value}")
    for row, values in zip(_AXES, calibration.accel_matrix, strict=True):
        for column, value in zip(_AXES, _millionths(values), strict=True):
            lines.append(f"CONFIG_BV_CAL_ACCEL_M_{row}{column}_PPM={value}")
    for axis, value in zip(_AXES, _millionths(calibration.gyro_bias_radps), strict=True):
        lines.append(f"CONFIG_BV_CAL_GYRO_BIAS_{axis}_URADPS={value}")
    return "\n".join(lines) + "\n"


def _millionths(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> list[int]:
    return [round(float(value) * 1e6) for value in values]
