# SPDX-License-Identifier: Apache-2.0
"""docs/licences.md, from the lock and the table of parts: ``python -m hil.sbom.page``."""

from __future__ import annotations

import sys
from importlib import metadata
from pathlib import Path

from hil.atomic import write_whole
from hil.sbom import packages, parts

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "licences.md"
LOCK = ROOT / "ci" / "requirements.lock"
HEAD = """# Licences

Written by `python -m hil.sbom.page`; checked by `make lint`. This project is Apache-2.0. What an
image holds, with revisions and hashes, is in its bill of materials: `hil sbom`.

## In the firmware

| part | licence |
|---|---|
"""
PYTHON = """
## Python packages

All of the development set-up, as `ci/requirements.lock` fixes them for Linux and Python 3.11; the
licence is what each package's metadata say.

| package | version | licence |
|---|---|---|
"""


def render() -> str:
    """The page.

    Raises:
        PackageNotFoundError: a package of the lock is not installed.
    """
    firmware = {**parts.LICENCES, "eigen": parts.EIGEN, "BabbleSim (simulation)": parts.BABBLESIM}
    lines = [f"| {name} | {licence} |" for name, licence in firmware.items()]
    rows = [
        f"| {name} | {version} | {packages.licence(metadata.metadata(name))} |"
        for name, version in packages.locked(LOCK)
    ]
    return HEAD + "\n".join(lines) + "\n" + PYTHON + "\n".join(rows) + "\n"


def main(arguments: list[str]) -> int:
    """Write the page, or with ``--check`` exit 1 when it is not what the lock says."""
    page = render()
    if "--check" in arguments:
        same = PAGE.is_file() and PAGE.read_text(encoding="utf-8") == page
        if not same:
            print(f"{PAGE} is not what the lock says: python -m hil.sbom.page")
        return 0 if same else 1
    write_whole(PAGE, page.encode("utf-8"))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
