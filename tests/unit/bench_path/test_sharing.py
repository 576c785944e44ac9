# SPDX-License-Identifier: Apache-2.0
"""One bench, several people: whoever talks to a board of it holds it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from hil import units
from hil.bench import lock
from hil.bench.errors import BenchBusyError
from hil.cli import app
from tests.bench.virtual.world import World


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    with World(tmp_path / "w") as bench:
        bench.install(monkeypatch)
        yield bench


def test_a_tool_that_talks_to_a_unit_holds_the_bench(world: World) -> None:
    bench = world.bench_file(analyser=False)
    with units.on_bench("leader", bench):
        with pytest.raises(BenchBusyError, match="in use by"), lock.hold(bench):
            pass
        with pytest.raises(BenchBusyError), units.on_bench("follower", bench):
            pass
    with lock.hold(bench):
        pass


def test_a_log_holds_the_bench_and_named_ports_do_not(world: World, tmp_path: Path) -> None:
    bench = world.bench_file(analyser=False)
    taken, named = tmp_path / "taken.mcap", tmp_path / "named.mcap"

    def log(output: Path, *more: str) -> BaseException | None:
        arguments = ["log", "-o", str(output), "--duration", "0.2s", *more]
        return CliRunner().invoke(app, arguments).exception

    of_bench = ("--bench-file", str(bench))
    with lock.hold(bench):
        assert isinstance(log(taken, *of_bench), BenchBusyError)
        assert not taken.exists()
        port = world._ports["leader"]
        assert port is not None
        assert log(named, "--port", f"leader={port.path}") is None
    assert log(taken, *of_bench) is None
    assert taken.exists()
