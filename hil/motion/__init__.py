# SPDX-License-Identifier: Apache-2.0
"""Truth to judge estimators by: bars, lifts, sensors and repetitions, all seeded and analytic.

:mod:`~hil.motion.lifts` makes a set of repetitions, :mod:`~hil.motion.bar` says how any point
of the bar moves in it, :mod:`~hil.motion.imu_model` what an LSM6DSOX there puts out, and
:mod:`~hil.motion.repetitions` what the lifter's velocities truly were. :mod:`~hil.motion.sprint`
is a run instead of a lift.
"""
