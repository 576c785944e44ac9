# SPDX-License-Identifier: Apache-2.0
"""Recordings for other programs, and other programs' IMU data as recordings.

:func:`hil.exchange.contents.contents` makes tables of a recording; one module per format writes
them. :mod:`hil.exchange.sheets` reads foreign files, :mod:`hil.exchange.foreign` says what their
columns are, :mod:`hil.exchange.recorded` makes a recording of them. docs/exchange.md describes it.
"""
