# SPDX-License-Identifier: Apache-2.0
"""Figures of a recording, for a paper or a wall: samples, velocity, the full state, stillness.

:mod:`hil.plot.figure` chooses what is drawn, :mod:`hil.plot.picture` draws it as SVG (and PNG),
:mod:`hil.plot.page` as a page that zooms.
"""
