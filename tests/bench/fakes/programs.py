# SPDX-License-Identifier: Apache-2.0
"""Doubles of external programs: they record how they were called and answer as they are told."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

import pytest

DOUBLE = """#!{python} -IS
import json, re, sys
here = {folder!r}
name = {name!r}
call = [name, *sys.argv[1:]]
text = " ".join(call)
for flag in ("-CommandFile",):
    if flag in call:
        text += "\\n" + open(call[call.index(flag) + 1]).read()
with open(here + "/calls.jsonl", "a") as log:
    log.write(json.dumps({{"argv": call, "text": text}}) + "\\n")
for answer in json.load(open(here + "/answers.json")):
    if answer["name"] == name and (match := re.search(answer["when"], text)):
        if answer["write"]:
            open(match[1], "wb").write(bytes.fromhex(answer["write"]))
        sys.stdout.write(answer["say"])
        sys.exit(answer["status"])
"""


class Programs:
    """A folder of doubles that is all of ``PATH``."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._answers: list[dict[str, Any]] = []
        self._save()

    def install(self, name: str) -> None:
        """Make a program of this name; it says nothing and succeeds."""
        path = self.folder / name
        path.write_text(
            DOUBLE.format(python=sys.executable, folder=str(self.folder), name=name),
            encoding="utf-8",
        )
        path.chmod(0o755)

    def answer(
        self, name: str, when: str, say: str = "", *, status: int = 0, write: bytes = b""
    ) -> None:
        """When the call matches ``when``, say this; ``write`` goes to the file of its group 1."""
        self._answers.append(
            {"name": name, "when": when, "say": say, "status": status, "write": write.hex()}
        )
        self._save()

    def calls(self) -> list[list[str]]:
        """The argument lists of all calls so far."""
        return [call["argv"] for call in self._log()]

    def texts(self) -> list[str]:
        """The calls as text, each with the content of its command file."""
        return [call["text"] for call in self._log()]

    def forget(self) -> None:
        (self.folder / "calls.jsonl").unlink(missing_ok=True)

    def _log(self) -> list[dict[str, Any]]:
        path = self.folder / "calls.jsonl"
        if not path.exists():
            return []
        return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]

    def _save(self) -> None:
        text = json.dumps(self._answers)
        (self.folder / "answers.json").write_text(text, encoding="utf-8")


def programs_on_path(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Programs:
    """Doubles in ``folder``, which becomes the whole of ``PATH``."""
    folder.mkdir(parents=True, exist_ok=True)
    monkeypatch.setenv("PATH", str(folder))
    assert os.environ["PATH"] == str(folder)
    return Programs(folder)
