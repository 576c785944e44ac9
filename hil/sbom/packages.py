# SPDX-License-Identifier: Apache-2.0
"""The Python packages: which the rig needs, which are locked, and their licences."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Final

from packaging.markers import Marker
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

HERE: Final[Mapping[str, str]] = {
    "implementation_name": "cpython",
    "os_name": "posix",
    "platform_machine": "x86_64",
    "platform_python_implementation": "CPython",
    "platform_system": "Linux",
    "python_full_version": "3.11.0",
    "python_version": "3.11",
    "sys_platform": "linux",
}
"""The platform that the lists speak of, whichever they are made on."""

CLASSIFIERS: Final[Mapping[str, str]] = {
    "Apache Software License": "Apache-2.0",
    "BSD License": "BSD-3-Clause",
    "GNU Lesser General Public License v3 (LGPLv3)": "LGPL-3.0-only",
    "ISC License (ISCL)": "ISC",
    "MIT License": "MIT",
    "MIT No Attribution License (MIT-0)": "MIT-0",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
    "The Unlicense (Unlicense)": "Unlicense",
}
_SPOKEN: Final[Mapping[str, str]] = {
    "apache 2.0": "Apache-2.0",
    "apache license 2.0": "Apache-2.0",
    "apache license, version 2.0": "Apache-2.0",
    "apache-2.0": "Apache-2.0",
    "bsd": "BSD-3-Clause",
    "bsd-2-clause": "BSD-2-Clause",
    "bsd-3-clause": "BSD-3-Clause",
    "isc": "ISC",
    "mit": "MIT",
    "mit license": "MIT",
    "mpl-2.0": "MPL-2.0",
    "mpl2": "MPL-2.0",
    "psf-2.0": "PSF-2.0",
}
READ: Final[Mapping[str, str]] = {
    "atheris": "Apache-2.0",
    "pynrfjprog": "LicenseRef-Nordic-5-Clause",
    "resvg-py": "MIT",
}
"""Packages whose metadata do not say it, by the licence text that they come with."""
_LOCKED: Final = re.compile(r"^([A-Za-z0-9._-]+)==([^\s;]+)\s*(?:;\s*([^\\]+?))?\s*\\?$")


@dataclass(frozen=True)
class Package:
    """A Python package; ``licence`` is an SPDX expression, or the package's own words."""

    name: str
    version: str
    licence: str


def locked(lock: Path) -> list[tuple[str, str]]:
    """Name and version of what the lock installs on the platform of :data:`HERE`."""
    found = []
    for line in lock.read_text(encoding="utf-8").splitlines():
        match = _LOCKED.match(line)
        if match and (match[3] is None or Marker(match[3]).evaluate(dict(HERE))):
            found.append((match[1], match[2]))
    return found


def needed(root: str = "hil", extras: tuple[str, ...] = ()) -> list[Package]:
    """The installed packages that ``root`` with these extras needs, and theirs, by name."""
    found: dict[str, Package] = {}
    wanted = [(root, frozenset(extras))]
    seen = set(wanted)
    while wanted:
        name, some = wanted.pop()
        try:
            there = metadata.distribution(name)
        except metadata.PackageNotFoundError:
            continue
        if name != root:
            found[name] = Package(name, there.version, licence(there.metadata))
        for one in _requirements(there, some):
            step = (canonicalize_name(one.name), frozenset(one.extras))
            if step not in seen:
                seen.add(step)
                wanted.append(step)
    return [found[name] for name in sorted(found)]


def _requirements(there: metadata.Distribution, extras: frozenset[str]) -> Iterator[Requirement]:
    for text in there.requires or ():
        one = Requirement(text)
        if one.marker is None or any(
            one.marker.evaluate({"extra": extra}) for extra in (*extras, "")
        ):
            yield one


def licence(described: metadata.PackageMetadata) -> str:
    """The licence that a package's metadata names: its SPDX expression where it has one."""
    name = canonicalize_name((described.get_all("Name") or [""])[0])
    if name in READ:
        return READ[name]
    if expressions := described.get_all("License-Expression"):
        return str(expressions[0])
    classified = [
        text.rpartition(" :: ")[2]
        for text in described.get_all("Classifier") or ()
        if text.startswith("License :: ") and not text.endswith("OSI Approved")
    ]
    known = sorted({CLASSIFIERS[text] for text in classified if text in CLASSIFIERS})
    if known:
        return " OR ".join(known)
    words = " ".join(" ".join(described.get_all("License") or ()).split())
    return _SPOKEN.get(words.lower(), words[:60]) or ", ".join(classified) or "not stated"
