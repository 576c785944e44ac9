# SPDX-License-Identifier: Apache-2.0
"""The folder of recordings."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil import library, synthesis
from hil.errors import RecordingError
from hil.synthesis import Plan


@pytest.mark.parametrize("name", ["", "../up", "a/b", ".hidden", "with space", "x\n"])
def test_a_name_that_is_no_plain_file_name_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(RecordingError, match="cannot be a recording's name"):
        library.target(tmp_path, name)


def test_a_name_that_is_taken_is_refused(tmp_path: Path) -> None:
    library.target(tmp_path, "one").write_bytes(b"")
    with pytest.raises(RecordingError, match="there is a recording"):
        library.target(tmp_path, "one")


def test_readme_says_where_the_recording_came_from(tmp_path: Path) -> None:
    path = library.target(tmp_path, "one")
    recording = synthesis.save(synthesis.synthesise(Plan(duration_s=3)), path)
    library.write_readme(recording, path)
    text = (path.parent / "README.md").read_text(encoding="utf-8")
    assert "Synthetic: computed, no firmware ran" in text
    assert "Nothing here was measured on silicon" in text


def test_recordings_are_found_by_name(tmp_path: Path) -> None:
    for name in ("b", "a"):
        library.target(tmp_path, name).write_bytes(b"")
    assert [p.parent.name for p in library.find(tmp_path)] == ["a", "b"]
    assert library.resolve(tmp_path / "a") == tmp_path / "a" / library.FILE_NAME
