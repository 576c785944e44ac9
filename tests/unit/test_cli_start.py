# SPDX-License-Identifier: Apache-2.0
"""The top level knows each command by a line of a table; the commands themselves say the same."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys
from importlib import import_module

import pytest
import typer
from typer.testing import CliRunner

from hil.cli import COMMANDS, app


def first_line(name: str) -> str:
    """What the command says of itself, up to the first empty line."""
    module, attribute = COMMANDS[name][0].split(":")
    found = getattr(import_module(module), attribute)
    told = found.info.help if isinstance(found, typer.Typer) else inspect.getdoc(found)
    return " ".join(told.split("\n\n")[0].split())


def run(code: str, **environment: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    ).stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_the_table_says_what_the_command_says(name: str) -> None:
    assert COMMANDS[name][1] == first_line(name)


def test_help_lists_every_command_and_imports_none() -> None:
    told = run(
        "import sys; from typer.testing import CliRunner; from hil.cli import COMMANDS, app;"
        "print(CliRunner().invoke(app, ['--help']).output);"
        "known = {where.split(':')[0] for where, _ in COMMANDS.values()};"
        "print('imported:', sorted(known & set(sys.modules)), 'rich.markdown' in sys.modules)"
    )
    listed = [line.split()[0] for line in told.split("Commands:")[1].splitlines() if line.strip()]
    assert set(COMMANDS) <= set(listed)
    assert "imported: [] False" in told


@pytest.mark.parametrize(("command", "inner"), [("tune", "zupt"), ("history", "show")])
def test_a_group_lists_its_commands(command: str, inner: str) -> None:
    told = CliRunner().invoke(app, [command, "--help"])
    assert told.exit_code == 0
    assert inner in told.output


def test_a_mistyped_command_is_told_what_there_is() -> None:
    told = CliRunner().invoke(app, ["repalay"])
    assert told.exit_code == 2
    assert "Did you mean 'replay'" in told.output


@pytest.mark.parametrize(
    ("words", "wanted"), [("hil repl", "replay"), ("hil replay --inj", "--inject")]
)
def test_the_shell_completes_commands_and_options(words: str, wanted: str) -> None:
    code = "import sys; sys.argv = ['hil']; from hil.cli import main; main()"
    position = str(words.count(" "))
    told = run(code, _HIL_COMPLETE="complete_bash", COMP_WORDS=words, COMP_CWORD=position)
    assert told.split() == [wanted]
