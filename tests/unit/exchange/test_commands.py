# SPDX-License-Identifier: Apache-2.0
"""``hil export`` and ``hil import`` as a person calls them, and Rerun where it is installed."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

from hil.cli import app
from hil.exchange import extras
from hil.exchange.table import ExchangeError
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
    with pytest.raises(ExchangeError, match="needs no_such_library") as caught:
        extras.module("no_such_library")
    assert caught.value.mend == "pip install 'hil[parquet]'"


@pytest.mark.skipif(shutil.which("rerun") is None, reason="rerun-sdk is 490 MB, and not installed")
def test_rerun_decodes_every_topic(tmp_path):
    file, made = tmp_path / "x.mcap", tmp_path / "x.rrd"
    assert hil("export", CAL_BOOT, "-o", file, "--format", "mcap").exit_code == 0
    subprocess.run(["rerun", "mcap", "convert", file, "-o", made], check=True, timeout=300)
    text = subprocess.run(
        ["rerun", "rrd", "print", made, "-vv"], check=True, timeout=300, capture_output=True
    ).stdout.decode()
    for decoded in ('"velocity_z_mps": non-null Float64', "Transform3D:quaternion", "TextLog:text"):
        assert decoded in text
