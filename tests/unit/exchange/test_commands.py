# SPDX-License-Identifier: Apache-2.0
"""``hil export`` and ``hil import`` as a person calls them."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from hil import extras
from hil.cli import app
from hil.errors import HilError
from hil.recording import load

CAL_BOOT = Path(__file__).parents[3] / "fixtures" / "recordings" / "cal-boot"


def hil(*args):
    return CliRunner().invoke(app, [str(a) for a in args])


def test_out_and_in(tmp_path):
    file = tmp_path / "x.npz"
    result = hil("export", CAL_BOOT, "-o", file, "--format", "npz")
    assert result.exit_code == 0, result.output
    assert "imu_leader" in result.output
    result = hil("import", file, "-o", tmp_path / "again")
    assert result.exit_code == 0, result.output
    assert load(tmp_path / "again" / "recording.mcap").provenance.source == "import"
    readme = (tmp_path / "again" / "README.md").read_text(encoding="utf-8")
    assert "Imported from foreign data" in readme


def test_a_column_that_is_none_is_wrong_use(tmp_path):
    result = hil("import", "x.csv", "-o", tmp_path / "y", "--column", "gyro=x")
    assert result.exit_code == 2


def test_a_missing_library_names_its_extra(monkeypatch):
    monkeypatch.setitem(extras.EXTRAS, "no_such_library", "parquet")
    with pytest.raises(HilError, match="needs no_such_library") as caught:
        extras.module("no_such_library")
    assert caught.value.mend == "pip install 'hil[parquet]'"
