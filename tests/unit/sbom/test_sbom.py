# SPDX-License-Identifier: Apache-2.0
"""The bill of materials is valid by its own schema and says what the images are made of."""

from __future__ import annotations

import email
import hashlib
import json
from dataclasses import replace
from pathlib import Path

import pytest
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

from hil.errors import BuildError
from hil.sbom import packages, page, parts
from hil.sbom.document import render
from tests.bench.fakes.images import built

COMMIT = "0123456789abcdef0123456789abcdef01234567"


@pytest.fixture
def zephyr(tmp_path: Path) -> Path:
    base = tmp_path / "zephyr"
    base.mkdir()
    (base / "west.yml").write_text(
        f"manifest:\n  projects:\n    - name: hal_st\n      revision: {COMMIT}\n"
        "    - name: cmsis\n      revision: v1\n"
    )
    return base


@pytest.fixture
def image(tmp_path: Path) -> Path:
    folder = tmp_path / "leader"
    replace(built(folder, "leader"), toolchain="gcc 12.2", zephyr_commit="ab" * 20).save()
    (folder / "zephyr_modules.txt").write_text(
        '"hal_st":"/w/hal/st":"x"\n"cmsis":"/w/cmsis":"y"\n"bv_firmware":"/f":"/f"\n'
    )
    return folder


def made(image: Path, zephyr: Path) -> dict[str, object]:
    linked = {part.name: part for part in parts.linked(image, zephyr, "ab" * 20)}
    text = render([parts.manifest_of(image)], linked, packages.needed(extras=("build",)))
    assert JsonStrictValidator(SchemaVersion.V1_6).validate_str(text) is None
    return dict(json.loads(text))


def test_it_is_valid_and_holds_hashes_revisions_and_licences(image: Path, zephyr: Path) -> None:
    document = made(image, zephyr)
    by_ref = {one["bom-ref"]: one for one in document["components"]}  # type: ignore[attr-defined]
    assert by_ref["firmware:hal_st"]["version"] == COMMIT
    assert by_ref["firmware:hal_st"]["licenses"] == [
        {"license": {"acknowledgement": "declared", "id": "BSD-3-Clause"}}
    ] or by_ref["firmware:hal_st"]["licenses"] == [{"license": {"id": "BSD-3-Clause"}}]
    assert by_ref["firmware:zephyr"]["version"] == "ab" * 20
    assert "firmware:bv_firmware" not in by_ref
    assert by_ref["pypi:numpy"]["purl"].startswith("pkg:pypi/numpy@")
    (leader,) = (one for ref, one in by_ref.items() if ref.startswith("image:"))
    hashes = {one["name"]: one["hashes"][0]["content"] for one in leader["components"]}
    for name, digest in hashes.items():
        assert hashlib.sha256((image / name).read_bytes()).hexdigest() == digest
    assert hashes
    said = json.dumps(document["metadata"])
    assert "gcc 12.2" in said


def test_equal_inputs_give_equal_text(image: Path, zephyr: Path) -> None:
    assert made(image, zephyr) == made(image, zephyr)


def test_the_validator_would_notice(image: Path, zephyr: Path) -> None:
    document = made(image, zephyr)
    document["components"][0]["type"] = "nonsense"  # type: ignore[index]
    found = JsonStrictValidator(SchemaVersion.V1_6).validate_str(json.dumps(document))
    assert found is not None


def test_an_image_that_was_changed_is_refused(image: Path) -> None:
    (file,) = list(image.rglob("*.hex"))
    file.write_bytes(file.read_bytes() + b"\n")
    with pytest.raises(BuildError, match="not as it was built"):
        parts.manifest_of(image)


def test_a_module_of_unknown_licence_is_refused(image: Path, zephyr: Path) -> None:
    (image / "zephyr_modules.txt").write_text('"novel":"/w/novel":"x"\n')
    with pytest.raises(BuildError, match="novel is not known"):
        parts.linked(image, zephyr)


@pytest.mark.parametrize(
    ("said", "licence"),
    [
        ("License-Expression: MIT AND Zlib\nLicense: other", "MIT AND Zlib"),
        ("Classifier: License :: OSI Approved :: MIT License", "MIT"),
        ("License: Apache 2.0", "Apache-2.0"),
        ("License: \n Public\n domain", "Public domain"),
        ("Name: x", "not stated"),
    ],
)
def test_the_licence_is_what_the_metadata_say(said: str, licence: str) -> None:
    described = email.message_from_string(said + "\n")
    assert packages.licence(described) == licence  # type: ignore[arg-type]


def test_every_line_of_the_lock_has_hashes_and_is_on_the_page() -> None:
    text = page.LOCK.read_text()
    for block in text.split("\n\n")[-1].replace("\\\n", "").splitlines():
        if block and not block.startswith("#"):
            assert block.count("--hash=sha256:") >= 1, block
    listed = page.PAGE.read_text()
    names = packages.locked(page.LOCK)
    assert len(names) > 80
    assert all(f"| {name} | {version} |" in listed for name, version in names)
