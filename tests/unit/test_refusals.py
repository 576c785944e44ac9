# SPDX-License-Identifier: Apache-2.0
"""What each command says of wrong input; the rows are a table of docs/refusals.md."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Final

import pytest

from hil import cli

ROOT = Path(__file__).parents[2]
DOCUMENT = ROOT / "docs" / "refusals.md"
CLEAN = ROOT / "fixtures" / "recordings" / "clean-7ms5"
SCENARIO = ROOT / "fixtures" / "scenarios" / "imu-rest.toml"
BEGIN = "<!-- Rows of tests/unit/test_refusals.py: begin -->"
END = "<!-- end of these -->"

ROWS: Final = (
    "log --port x",
    "log --port leader=/dev/nope",
    "log --port leader=/dev/null",
    "log --port leader=/a --port leader=/b",
    "log --port leader=/a --role leader",
    "log --port leader=/a --rotate 0s",
    "log --port leader=/a --rotate-size 5",
    "log --port leader=/a --duration soon",
    "log --bench-file nope.toml",
    "log --from nope --csv out.csv",
    "log --from empty.mcap --csv out.csv",
    "log --from CLEAN",
    "stringpot calibrate",
    "stringpot calibrate --point 1=2",
    "stringpot calibrate --point x --point y",
    "stringpot calibrate --point 1=2 --point 1=3",
    "stringpot calibrate --port /dev/nope --lengths 0,500",
    "stringpot calibrate --port /dev/nope --lengths long",
    "stringpot log --port /dev/nope",
    "stringpot convert CLEAN",
    "stringpot convert CLEAN --calibration junk.csv",
    "link-key",
    "live nope",
    "live empty.mcap",
    "live junk.csv",
    "live CLEAN --board sim",
    "live CLEAN --port leader=/dev/nope",
    "live CLEAN --speed -1",
    "plot nope -o a.svg",
    "plot empty.mcap -o a.svg",
    "plot CLEAN -o a.doc",
    "plot CLEAN -o taken.svg",
    "export CLEAN -o a --format word",
    "export cut.mcap -o a --format csv",
    "export CLEAN -o taken.svg --format csv",
    "import nope -o a",
    "import junk.csv -o a",
    "tune zupt nope",
    "tune zupt empty.mcap",
    "tune zupt CLEAN --cells 1",
    "tune ekf CLEAN --sets 0",
    "truth CLEAN nope.csv",
    "truth CLEAN junk.csv",
    "truth CLEAN nan.csv",
    "compare nope",
    "compare cut.mcap",
    "compare --broad 14",
    "soak nope",
    "soak empty.mcap",
    "soak junk.csv",
    "soak CLEAN",
    "sbom nope",
    "reps CLEAN --csv /proc/none/x.csv",
    "record nope.toml -o a",
    "record SCENARIO -o a --inject gremlins",
    "record SCENARIO -o a --inject drop=2",
    "record SCENARIO -o a --speed -1",
    "replay CLEAN --inject storm=3@1..2",
    "replay CLEAN --param gravity=none",
)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with files that are wrong in their ways."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("HIL_DATA", raising=False)
    monkeypatch.setenv("COLUMNS", "300")
    monkeypatch.setenv("TERM", "dumb")
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "cut.mcap").write_bytes((CLEAN / "recording.mcap").read_bytes()[:3000])
    (tmp_path / "junk.csv").write_text("junk\n")
    (tmp_path / "nan.csv").write_text("time,height\n0,1\n1,nan\n")
    (tmp_path / "taken.svg").mkdir()
    return tmp_path


def said(row: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> str:
    """The message of one wrong command line, after it was seen to be a refusal."""
    words = {"CLEAN": str(CLEAN), "SCENARIO": str(SCENARIO)}
    monkeypatch.setattr(sys, "argv", ["hil", *(words.get(word, word) for word in row.split())])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    told = capsys.readouterr()
    assert caught.value.code == 2, (row, caught.value.code, told.err[-500:])
    assert "Traceback" not in told.err + told.out, row
    found = re.search(r"(?:^hil: |Error: |Error[ :─╮│]*\n?│ )(.+)", told.err, re.MULTILINE)
    assert found is not None, (row, told.err)
    return found[1].rstrip(" │").replace(str(ROOT), "…")


def table(messages: dict[str, str]) -> str:
    lines = [
        f"| `hil {row}` | {text.replace('|', chr(92) + '|')} |" for row, text in messages.items()
    ]
    return "\n".join([BEGIN, "", "| command line | message |", "|---|---|", *lines, "", END])


def test_each_wrong_command_line_is_refused_as_the_manual_says(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = sorted(here.rglob("*"))
    wanted = table({row: said(row, capsys, monkeypatch) for row in ROWS})
    assert sorted(here.rglob("*")) == before, "something was written"
    text = DOCUMENT.read_text(encoding="utf-8")
    found = text[text.index(BEGIN) : text.index(END) + len(END)]
    anew = here / "section.md"
    anew.write_text(wanted, encoding="utf-8")
    assert found == wanted, f"the section of docs/refusals.md, as it is now: {anew}"
