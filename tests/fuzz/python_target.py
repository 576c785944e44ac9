# SPDX-License-Identifier: Apache-2.0
"""A Python target under atheris: ``-m tests.fuzz.python_target NAME [libFuzzer options]``."""

from __future__ import annotations

import importlib
import sys

import atheris


def main() -> None:
    name = sys.argv.pop(1)
    # What is compiled only the finder of an editable install knows.
    importlib.import_module("hil.wire._native")
    # The finder of an editable install comes before atheris', and what it loads has no coverage.
    sys.meta_path = [f for f in sys.meta_path if "editable" not in type(f).__module__]
    with atheris.instrument_imports(include=["hil"]):
        target = importlib.import_module(f"tests.fuzz.{name}")
    if hasattr(target, "mutate"):
        # Every other change is libFuzzer's own.
        def mutate(data: bytes, max_size: int, seed: int) -> bytes:
            if seed % 2 and data:
                return bytes(target.mutate(bytes(data), max_size, seed))
            return bytes(atheris.Mutate(data, max_size))

        atheris.Setup(sys.argv, target.run, custom_mutator=mutate)
    else:
        atheris.Setup(sys.argv, target.run)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
