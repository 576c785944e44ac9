# SPDX-License-Identifier: Apache-2.0
"""The live page: what two nodes say, in a browser, while they say it.

Data flow one way: bytes of a source (:mod:`hil.live.sources`) -> records
(:class:`hil.wire.live.LiveStream`) -> the state of the page (:class:`hil.live.page.Page`, which
knows neither clock nor network) -> frames to browsers (:mod:`hil.live.server`).
"""
