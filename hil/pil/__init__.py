# SPDX-License-Identifier: Apache-2.0
"""Processor in the loop: the firmware's estimator on an emulated Cortex-M4F.

    image = build()
    found = assess(image, simulated("bench", seed=3))
    found.comparison.first            # None: equal to the host core in every bit
    measurements(found)               # instructions, load, stack, heap, with limits

``firmware/pil`` is the program on the target's side; docs/estimator.md, section 11, says what is
measured and how far it may be trusted. Any :class:`hil.parity.Batch` will do as input: arrays of
both IMUs' samples, simulated or from a recording.
"""

from hil.pil.assess import Assessment, Model, assess, measurements
from hil.pil.compare import Comparison, compare, host_outputs
from hil.pil.emulator import TargetRun, run
from hil.pil.image import Image, build
from hil.pil.samples import recorded, simulated

__all__ = [
    "Assessment",
    "Comparison",
    "Image",
    "Model",
    "TargetRun",
    "assess",
    "build",
    "compare",
    "host_outputs",
    "measurements",
    "recorded",
    "run",
    "simulated",
]
