# SPDX-License-Identifier: Apache-2.0
"""The pytest plugin: one suite, three sources.

======================  ==========================================================
option                  the same suite runs on
======================  ==========================================================
(none)                  replay of the recordings in ``hil_recordings``
``--recording PATH``    replay of this one (repeatable)
``--board=sim``         the firmware, live, on the simulated radio
``--board[=bench]``     two boards, live, on the bench
======================  ==========================================================

In a project that asks for none of the fixtures the plugin does nothing; whatever is costly is
imported when a fixture needs it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from hil.bench import BENCH_FILE
from hil.history import DEFAULT_FILE as HISTORY_FILE

if TYPE_CHECKING:
    from hil.measure import Measurement
    from hil.recording import Recording
    from hil.wire.codec import Decoded

BOARDS = ("sim", "bench")
SOURCES = ("replay", *BOARDS)
EXIT_RIG_FAILURE = 10
EXIT_NOT_RUN_LIVE = 11
LONG_S = 600.0
"""A longer scenario runs only when it is named."""


@dataclass(frozen=True)
class RunSpec:
    """One run of the suite: which source, and the recording or scenario it takes."""

    source: str
    path: Path

    @property
    def id(self) -> str:
        stem = self.path.parent.name if self.path.suffix == ".mcap" else self.path.stem
        return f"{self.source}:{stem}"


@dataclass
class Session:
    """What the plugin gathers over a session: its settings, then its results."""

    board: str | None
    recordings: list[Path]
    scenarios: list[Path]
    record_name: str | None
    recordings_dir: Path
    runs_dir: Path
    inject: list[str]
    report_dir: Path | None
    workspace: Path | None
    images: Path | None
    lock_wait_s: float
    history: Path | None
    results: dict[str, tuple[Recording, list[Measurement]]]
    rig_failures: list[str]
    not_run: list[tuple[RunSpec, str]] = field(default_factory=list)
    ran: int = 0
    used: bool = False


_SESSION = pytest.StashKey[Session]()


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("hil", "hardware in the loop")
    group.addoption(
        "--board",
        nargs="?",
        const="bench",
        default=None,
        metavar="sim|bench",
        help="run live: on the simulated radio (sim) or on two boards (bench, the default)",
    )
    group.addoption(
        "--recording",
        action="append",
        default=[],
        metavar="PATH",
        help="replay this recording (a folder or an .mcap file); may be repeated",
    )
    group.addoption(
        "--scenario",
        action="append",
        default=[],
        metavar="PATH",
        help="scenario for a live run; may be repeated (default: all in hil_scenarios)",
    )
    group.addoption(
        "--record", default=None, metavar="NAME", help="keep the live run as a new recording"
    )
    group.addoption(
        "--require-live",
        action="store_true",
        help=f"end with exit code {EXIT_NOT_RUN_LIVE} when nothing ran live",
    )
    group.addoption(
        "--inject",
        action="append",
        default=[],
        metavar="KIND[:STREAM][=VALUE][@FROM..TO]",
        help="make a fault, to see the checks catch it (docs/faults.md); may be repeated; e.g. "
        "drop=1e-4 or clock-jump=0.1@5",
    )
    group.addoption("--workspace", default=None, metavar="DIR", help="Zephyr workspace to build in")
    group.addoption(
        "--images",
        default=None,
        metavar="DIR",
        help="on the bench: images built before, in DIR/leader and DIR/follower",
    )
    group.addoption(
        "--lock-wait",
        default=0.0,
        type=float,
        metavar="S",
        help="on the bench: seconds to wait for another run to end",
    )
    group.addoption(
        "--hil-report",
        default=None,
        metavar="DIR",
        help="write report.json, junit.xml, badge.json, index.html",
    )
    group.addoption(
        "--hil-history",
        nargs="?",
        const=HISTORY_FILE,
        default=None,
        metavar="DB",
        help=f"keep the runs in this history ({HISTORY_FILE} when no DB is named): hil history",
    )
    parser.addini("hil_board", "default of --board", default="")
    parser.addini("hil_history", "default of --hil-history", default="")
    parser.addini("hil_recordings", "folder of recordings", default="fixtures/recordings")
    parser.addini("hil_scenarios", "folder of scenarios", default="fixtures/scenarios")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers",
        f"hil_source(*names): run this test only on these sources ({', '.join(SOURCES)})",
    )
    option = config.getoption
    board = option("--board") or os.environ.get("HIL_BOARD") or config.getini("hil_board") or None
    if board is not None and board not in BOARDS:
        raise pytest.UsageError(
            f"--board={board}: no such source; use --board=sim or --board=bench"
            + (f" (did you mean: --board=bench {board} ?)" if Path(board).exists() else "")
        )
    root = config.rootpath
    recordings = option("--recording") or _paths_from(os.environ.get("HIL_RECORDING"))
    if board and recordings:
        raise pytest.UsageError("--board runs live and --recording replays: give one of them")
    if option("--record") and not board:
        raise pytest.UsageError("--record keeps a live run: add --board=sim or --board=bench")
    if option("--inject"):
        _refuse_impossible(option("--inject"), board or "replay")
    bench_file = root / BENCH_FILE
    if board == "bench" and not bench_file.is_file():
        raise pytest.UsageError(
            f"--board=bench needs {bench_file}, which does not exist: it says which probe is "
            "the leader and which the follower. Connect both boards and write it: hil bench init. "
            "Without boards use --board=sim, or no option to replay recordings."
        )
    kept = config.getini("hil_history")
    config.stash[_SESSION] = Session(
        board=board,
        recordings=[Path(p) for p in recordings],
        scenarios=[Path(p) for p in option("--scenario")],
        record_name=option("--record"),
        recordings_dir=root / config.getini("hil_recordings"),
        runs_dir=root / "build" / "runs",
        inject=option("--inject"),
        report_dir=Path(option("--hil-report")) if option("--hil-report") else None,
        workspace=Path(option("--workspace")) if option("--workspace") else None,
        images=Path(option("--images")) if option("--images") else None,
        lock_wait_s=option("--lock-wait"),
        history=Path(option("--hil-history") or root / kept)
        if option("--hil-history") or kept
        else None,
        results={},
        rig_failures=[],
    )


def _paths_from(variable: str | None) -> list[str]:
    return [p for p in (variable or "").split(os.pathsep) if p]


def _refuse_impossible(texts: Sequence[str], source: str) -> None:
    """Before anything is collected.

    Raises:
        pytest.UsageError: one is no fault, or none of such a run.
    """
    from hil import faults  # noqa: PLC0415 (kept out of other projects' start-up)
    from hil.errors import HilError  # noqa: PLC0415

    try:
        faults.refuse_unless_possible(faults.parse_all(texts), source)
    except HilError as error:
        raise pytest.UsageError(str(error)) from error


def _specs(config: pytest.Config) -> list[RunSpec]:
    """The runs that this session's options ask for.

    Raises:
        pytest.UsageError: an option names nothing that exists.
    """
    from hil import library  # noqa: PLC0415 (kept out of other projects' start-up)
    from hil.errors import HilError  # noqa: PLC0415

    session = config.stash[_SESSION]
    try:
        if session.board:
            folder = config.rootpath / config.getini("hil_scenarios")
            scenarios = session.scenarios or _passing_scenarios(folder)
            if not scenarios:
                raise pytest.UsageError(f"no scenario in {folder}: name one with --scenario PATH")
            return [RunSpec(session.board, path) for path in scenarios]
        if session.recordings:
            return [RunSpec("replay", library.resolve(path)) for path in session.recordings]
        return [
            RunSpec("replay", path)
            for path in library.find_expected_to_pass(session.recordings_dir)
        ]
    except HilError as error:
        raise pytest.UsageError(str(error)) from error


def _passing_scenarios(folder: Path) -> list[Path]:
    from hil import scenario  # noqa: PLC0415

    loaded = [(path, scenario.load(path)) for path in sorted(folder.glob("*.toml"))]
    return [
        path
        for path, plan in loaded
        if not plan.expect_fail and not plan.inject and plan.duration_s <= LONG_S
    ]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "recording" not in metafunc.fixturenames or not _is_ours(metafunc):
        return
    session = metafunc.config.stash[_SESSION]
    specs = _specs(metafunc.config)
    if not specs:
        raise pytest.UsageError(
            f"nothing to judge: no recording in {session.recordings_dir}; name one with "
            "--recording PATH, or run live with --board=sim"
        )
    metafunc.parametrize("recording", specs, ids=[s.id for s in specs], indirect=True)


def _is_ours(metafunc: pytest.Metafunc) -> bool:
    """False where a project has a ``recording`` fixture of its own."""
    definitions = metafunc.definition._fixtureinfo.name2fixturedefs.get("recording", ())
    return bool(definitions) and definitions[-1].func.__module__ == __name__


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    for item in items:
        for mark in item.iter_markers("hil_source"):
            unknown = [name for name in mark.args if name not in SOURCES]
            if unknown or not mark.args or mark.kwargs:
                raise pytest.UsageError(
                    f"{item.nodeid}: hil_source({', '.join(map(repr, mark.args))}): name one or "
                    f"more of {', '.join(SOURCES)}"
                )
        spec = _spec_of(item)
        wanted = [name for mark in item.iter_markers("hil_source") for name in mark.args]
        if spec and wanted and spec.source not in wanted:
            item.add_marker(
                pytest.mark.skip(reason=f"for {' or '.join(wanted)}, this is {spec.source}")
            )


def _spec_of(item: pytest.Item) -> RunSpec | None:
    callspec = getattr(item, "callspec", None)
    spec = callspec.params.get("recording") if callspec else None
    return spec if isinstance(spec, RunSpec) else None


@pytest.fixture(scope="session")
def recording(request: pytest.FixtureRequest) -> Recording:
    """The run being judged, live or replayed; tests need not know which."""
    from hil import faults, run  # noqa: PLC0415
    from hil.backends.replay import ReplayBackend  # noqa: PLC0415
    from hil.errors import HilError  # noqa: PLC0415

    session = request.config.stash[_SESSION]
    session.used = True
    spec: RunSpec = request.param
    injections = faults.parse_all(session.inject)
    try:
        if spec.source == "replay":
            result = ReplayBackend(spec.path, inject=injections).run(None, None, _silent)
        else:
            with _output(session, spec, request.config) as output:
                result = run.live(
                    board=spec.source,
                    scenario_path=spec.path,
                    workspace=session.workspace,
                    output=output,
                    progress=_terminal_progress(request.config),
                    bench=run.BenchOptions(
                        request.config.rootpath / BENCH_FILE, session.images, session.lock_wait_s
                    ),
                    inject=injections,
                )
            session.ran += 1
    except HilError as error:
        session.rig_failures.append(f"{spec.id}: {error}")
        session.not_run.append((spec, error.message))
        raise
    session.results.setdefault(spec.id, (result, []))
    return result


@contextmanager
def _output(session: Session, spec: RunSpec, config: pytest.Config) -> Iterator[Path]:
    """Where the run is to be written; what an earlier run left there is gone."""
    from hil import library  # noqa: PLC0415
    from hil.process import turn  # noqa: PLC0415

    if session.record_name is not None:
        several = len(session.scenarios) != 1
        name = f"{session.record_name}-{spec.path.stem}" if several else session.record_name
        yield library.target(session.recordings_dir, name)
        return
    path = session.runs_dir / spec.source / spec.path.stem / library.FILE_NAME
    if spec.source == "bench":
        # The bench has a lock of its own, and what is there is deleted when that is held.
        yield path
        return
    with turn(path.parent, lambda: _tell_waiting(config, path.parent)):
        path.unlink(missing_ok=True)
        yield path


def _tell_waiting(config: pytest.Config, folder: Path) -> None:
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if reporter is not None:
        with _not_captured(config):
            reporter.write_line(f"hil: waiting for another pytest that is writing {folder}")


def _silent(share: float, what: str) -> None:
    """Replay is quick enough to need no progress line."""


def _terminal_progress(config: pytest.Config) -> Callable[[float, str], None]:
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None or not reporter.isatty:
        return _silent

    def show(share: float, what: str) -> None:
        with _not_captured(config):
            reporter.ensure_newline()
            reporter.rewrite(f"  {share:4.0%} {what:<60.60}" if share < 1.0 else "", erase=True)
            if share >= 1.0:
                reporter.rewrite("")  # Back to the beginning of the line that is empty now.

    return show


def _not_captured(config: pytest.Config) -> AbstractContextManager[None]:
    """What is written within goes to the terminal, also while a fixture is at work."""
    capture = config.pluginmanager.get_plugin("capturemanager")
    return capture.global_and_fixture_disabled() if capture is not None else nullcontext()


@pytest.fixture(scope="session")
def leader(recording: Recording) -> Decoded:
    """The leader's decoded stream."""
    return recording.decoded("leader")


@pytest.fixture(scope="session")
def follower(recording: Recording) -> Decoded:
    """The follower's decoded stream."""
    return recording.decoded("follower")


@pytest.fixture(scope="session")
def images(recording: Recording) -> Mapping[str, Mapping[str, Any]]:
    """Role -> manifest of the image that ran: sha256, build id, flash and RAM, versions."""
    return recording.provenance.manifests


@pytest.fixture
def measure(
    request: pytest.FixtureRequest, recording: Recording
) -> Callable[[Measurement | Iterable[Measurement]], None]:
    """Judge measurements: keep them for the report and fail the test on a bad verdict."""
    from hil.measure import Measurement, Verdict  # noqa: PLC0415

    session = request.config.stash[_SESSION]
    spec = _spec_of(request.node)
    assert spec is not None
    kept = session.results[spec.id][1]

    def judge(measurements: Measurement | Iterable[Measurement]) -> None:
        if isinstance(measurements, Measurement):
            measurements = [measurements]
        batch = list(measurements)
        if not batch:
            pytest.fail("nothing was measured: the check has no measurement to judge")
        kept.extend(batch)
        for m in batch:
            request.node.user_properties.append((m.name, f"{m.value} {m.unit} {m.verdict}"))
        bad = [m for m in batch if not m.verdict.ok]
        if bad:
            pytest.fail("\n".join(_sentence(m) for m in bad), pytrace=False)
        if all(m.verdict is Verdict.UNSET for m in batch):
            pytest.skip("; ".join(m.how for m in batch))

    return judge


def _sentence(m: Measurement) -> str:
    uncertainty = f" ± {m.uncertainty:g}" if m.uncertainty else ""
    value = "no value" if m.value is None else f"{m.value:.6g}{uncertainty} {m.unit}"
    return (
        f"{m.verdict.upper()} {m.name}: {value}, limit {m.limits} {m.unit} "
        f"(error budget {m.budget}); {m.how}"
    )


def pytest_report_header(config: pytest.Config) -> str | None:
    session = config.stash[_SESSION]
    if session.board == "sim":
        return "hil: live, simulated radio, real firmware"
    if session.board == "bench":
        return "hil: live, two boards on the bench"
    return None


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    session = config.stash[_SESSION]
    if not session.used:
        return
    from hil import faults  # noqa: PLC0415

    terminalreporter.section("hil")
    for name, (recording, measurements) in session.results.items():
        counts: dict[str, int] = {}
        for m in measurements:
            counts[m.verdict.value] = counts.get(m.verdict.value, 0) + 1
        line = ", ".join(f"{n} {verdict}" for verdict, n in sorted(counts.items()))
        terminalreporter.write_line(f"{name}: {line or 'nothing measured'}")
        if said := faults.in_words(recording.provenance.scenario):
            terminalreporter.write_line(f"{name}: {said}", yellow=True)
    for failure in session.rig_failures:
        terminalreporter.write_line(f"rig failure: {failure}", red=True)
    if unnoticed := _unnoticed(session):
        terminalreporter.write_line(
            f"no check noticed the faults injected into {', '.join(unnoticed)}", red=True
        )
    if config.getoption("--require-live") and session.ran == 0:
        terminalreporter.write_line("not run live: --require-live was given", red=True)


def _unnoticed(session: Session) -> list[str]:
    """The runs into which faults were injected, and of which no measurement is bad."""
    return [
        name
        for name, (recording, measurements) in session.results.items()
        if recording.provenance.injected and all(m.verdict.ok for m in measurements)
    ]


@pytest.hookimpl(wrapper=True, trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> Generator[None, None, None]:
    state = session.config.stash[_SESSION]
    if (state.results or state.not_run) and (state.report_dir or state.history):
        _keep_results(session, state)
    if session.exitstatus == pytest.ExitCode.TESTS_FAILED and state.rig_failures:
        only_rig = session.testsfailed <= len(_errors(session))
        session.exitstatus = EXIT_RIG_FAILURE if only_rig else session.exitstatus
    elif session.exitstatus == pytest.ExitCode.OK and _unnoticed(state):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
    elif (
        session.exitstatus == pytest.ExitCode.OK
        and session.config.getoption("--require-live")
        and state.ran == 0
    ):
        session.exitstatus = EXIT_NOT_RUN_LIVE
    return (yield)


def _keep_results(session: pytest.Session, state: Session) -> None:
    """Write the report, and keep the runs; what goes wrong with either is the rig's failure."""
    from hil import checks, report  # noqa: PLC0415
    from hil.errors import HilError  # noqa: PLC0415

    results: list[report.Result | report.NotRun] = [
        report.Result(
            recording,
            measured,
            checks.series(recording) if state.report_dir else (),
            live=bool(state.board),
        )
        for recording, measured in state.results.values()
    ]
    results += [
        report.NotRun(spec.path.stem, spec.source, reason, rig_failed=True)
        for spec, reason in state.not_run
        if spec.source in BOARDS
    ]
    if not results:
        return
    document = report.build(results)
    try:
        if state.report_dir:
            report.write(document, state.report_dir)
        if state.history:
            from hil.history.store import open_history  # noqa: PLC0415

            with open_history(state.history, create=True) as history:
                history.add(document)
    except HilError as error:
        state.rig_failures.append(str(error))
        if session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = EXIT_RIG_FAILURE


def _errors(session: pytest.Session) -> list[Any]:
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    return list(reporter.stats.get("error", ())) if reporter else []
