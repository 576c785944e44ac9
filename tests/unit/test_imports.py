# SPDX-License-Identifier: Apache-2.0
"""The import rules that make the layout the architecture, read from the sources themselves."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PURE = (
    *("measure", "timesync", "imu", "link", "fusion"),
    *("motion", "reference", "core", "parity", "accuracy"),
)
BACKENDS = ("replay", "sim", "bench")

FORBIDDEN: list[tuple[str, tuple[str, ...]]] = [
    *((f"hil.{name}", ("hil.backends", "hil.bench", "pytest", "serial")) for name in PURE),
    ("hil.report", ("hil.backends",)),
    ("hil.reference", ("hil.core", "hil.parity", "hil.accuracy")),
    *(
        (f"hil.calibration.{name}", ("hil.backends", "hil.bench", "pytest", "serial"))
        for name in ("poses", "solve", "record", "kconfig", "allan", "measures", "tool")
    ),
    ("hil.bench", ("hil.backends", "hil.report", "hil.measure")),
    *(
        (f"hil.{name}", ("hil.backends", "hil.bench", "pytest", "serial"))
        for name in ("compare", "exchange", "faults", "history", "plot", "reps", "tuning", "truth")
    ),
    *(
        (f"hil.live.{name}", ("hil.backends", "hil.bench", "serial", "websockets", "asyncio"))
        for name in ("page", "health", "trail", "repetitions", "words", "access")
    ),
    *(
        (name, ("hil.backends", "hil.bench", "pytest", "serial"))
        for name in (
            *("hil.log.text", "hil.log.tables"),
            *(f"hil.stringpot.{part}" for part in ("samples", "calibration", "motion")),
        )
    ),
    *((f"hil.{name}", ("hil.backends", "hil.report", "pytest")) for name in ("log", "stringpot")),
    *(
        (
            f"hil.backends.{name}",
            (
                "hil.measure",
                "hil.report",
                *(f"hil.backends.{other}" for other in BACKENDS if other != name),
            ),
        )
        for name in BACKENDS
    ),
]
"""(module or package, what it must never import)."""

ONLY: list[tuple[str, tuple[str, ...]]] = [
    ("hil.wire", ("hil.wire",)),
    ("hil.recording", ("hil.recording", "hil.atomic", "hil.wire", "hil.errors")),
]
"""(module or package, the only parts of hil that it may import)."""


def sources() -> dict[str, Path]:
    """Dotted module name -> file, for every module of the package."""
    found = {}
    for path in sorted((ROOT / "hil").rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(text: str, module: str, is_package: bool) -> set[str]:
    """Every module that a source text imports, wherever the statement stands."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = module.split(".")
                keep = len(parts) - node.level + (1 if is_package else 0)
                base = ".".join([*parts[:keep], *([base] if base else [])])
            found.add(base)
            found |= {f"{base}.{alias.name}" for alias in node.names}
    return found


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(package + ".")


def violations() -> list[str]:
    bad = []
    for module, path in sources().items():
        used = imports(path.read_text(encoding="utf-8"), module, path.name == "__init__.py")
        for owner, never in FORBIDDEN:
            if within(module, owner):
                bad += [f"{module} imports {u}" for u in used for n in never if within(u, n)]
        for owner, allowed in ONLY:
            if within(module, owner):
                bad += [
                    f"{module} imports {u}"
                    for u in used
                    if within(u, "hil") and u != "hil" and not any(within(u, a) for a in allowed)
                ]
    return sorted(set(bad))


def test_no_forbidden_import() -> None:
    assert violations() == []


def test_the_libraries_that_the_rules_name_exist() -> None:
    """A rule about a folder that is not there would hold whatever anyone did."""
    for folder in ("wire", "estimator", "timesync"):
        assert list((ROOT / "firmware" / "lib" / folder).glob("*.[ch]*"))
    assert {"hil.core", "hil.reference"} <= set(sources())


@pytest.mark.parametrize(
    ("text", "module", "expected"),
    [
        ("import hil.backends.sim", "hil.imu", "hil.backends.sim"),
        ("from hil.backends import sim", "hil.imu", "hil.backends.sim"),
        ("from . import backends", "hil.imu", "hil.backends"),
        ("from ..backends import sim", "hil.wire.codec", "hil.backends.sim"),
        ("def f():\n    import serial", "hil.imu", "serial"),
    ],
)
def test_the_reader_sees_every_form_of_import(text: str, module: str, expected: str) -> None:
    assert expected in imports(text, module, is_package=False)


@pytest.mark.parametrize(
    "folder",
    ["lib/wire", "lib/estimator", "lib/timesync", "lib/calib", "lib/reps", "drivers/lsm6dsox"],
)
def test_pure_firmware_libraries_know_no_zephyr(folder: str) -> None:
    """The parts that also run on the host; ``*_ppi``, ``*_nvs`` and the bus half are the others."""
    pure = {
        "lib/timesync": ("sync_math",),
        "lib/calib": ("fit", "allan", "calib_boot", "calib_correct", "calib_record"),
        "drivers/lsm6dsox": ("decoder", "fifo_decoder"),
    }
    base = ROOT / "firmware" / folder
    for path in sorted(p for p in base.rglob("*") if p.suffix in {".c", ".h", ".cpp", ".hpp"}):
        if folder in pure and not any(name in path.stem for name in pure[folder]):
            continue
        text = path.read_text(encoding="utf-8")
        for header in ("<zephyr/", "<nrf", "<hal/", "<soc"):
            assert f"#include {header}" not in text, f"{path} includes {header}"


def test_hardware_libraries_load_only_when_used() -> None:
    """Importing the command line and the plugin loads neither NumPy nor a hardware library."""
    code = (
        "import sys, hil.plugin, hil.cli;"
        "print([m for m in ('numpy','serial','pynrfjprog','mcap','saleae','grpc','rich.progress',"
        "'matplotlib')"
        " if m in sys.modules])"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert result.stdout.strip() == "[]"
