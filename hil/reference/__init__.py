# SPDX-License-Identifier: Apache-2.0
"""The estimators in plain NumPy float64, one file each, to be read beside docs/estimator.md.

They are the independent reference for the C++ core: same algorithms, written for the reader,
with dense matrices and no attention to cost. :mod:`~hil.reference.estimator` is the step loop;
each other file holds one model: what it measures, its Jacobian, its noise and its gate.
:mod:`~hil.reference.sprint`, :mod:`~hil.reference.vertical_plane` and
:mod:`~hil.reference.zero_velocity` are other people's trackers: docs/estimators.md.
"""
