# SPDX-License-Identifier: Apache-2.0
"""Noise parameters of the estimator, searched on some recordings and judged on others.

The search is CMA-ES (Hansen 2016, arXiv:1604.00772), from the image's own parameters: it goes by
ranks alone, so gates that make the cost jump do it no harm, and a generation is evaluated at once
and told in its own order. So the answer depends on inputs, range, seed and number of trials, and
not on workers. Evaluations are kept one by one: a search that was killed asks for the same ones
again, finds them, and goes on.

A proposal must be better on recordings that it was not searched on.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from cmaes import CMA

from hil import library
from hil.errors import RecordingError
from hil.tuning import case, kept
from hil.tuning.axes import Axis, parse
from hil.tuning.case import Case
from hil.tuning.score import Figures, cost, evaluate
from hil.tuning.workers import Workers, locally, workers

Settings = dict[str, float]
Progress = Callable[[float, str], None]

SEED_FIRST: Final = 7000
"""First of the simulated sets; recordings, studies and trials of ``tune zupt`` use lower ones."""
SIGMA: Final = 0.15
"""Of the first generation, as a share of each range."""
TOGETHER: Final = 3
"""Candidates in a task: the truth of a case is worked out once for all of them."""
CURVE: Final = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Shares of its range at which each parameter is looked at alone, the others as proposed."""


@dataclass(frozen=True, eq=False)
class Source:
    """A recording, or a simulated set: all of its starts are searched on, or all judged on."""

    name: str
    cases: Sequence[Case]

    @property
    def digest(self) -> str:
        return kept.digest(*(one.digest for one in self.cases))


@dataclass(frozen=True)
class Score:
    """One case with the parameters of now and with the best ones."""

    name: str
    known: bool
    now: Figures
    best: Figures
    cost_now: float
    cost_best: float


@dataclass(frozen=True)
class Sensitivity:
    """One parameter alone, the others at their best.

    Attributes:
        values, costs: along its range; costs are of the training cases less those of now.
        put_back: cost with only this one put back to what it is now, less that of the best.
    """

    axis: Axis
    now: float
    best: float
    values: Sequence[float]
    costs: Sequence[float]
    put_back: float


@dataclass(frozen=True, eq=False)
class Tuned:
    """What was searched and found.

    Attributes:
        trials: choices of parameters tried; ``gain``: mean cost of now less that of the best, on
            the training cases.
        against: why nothing is proposed; empty where the best is the proposal.
    """

    training: Sequence[Score]
    held: Sequence[Score]
    parameters: Sequence[Sensitivity]
    trials: int
    against: str

    @property
    def proposal(self) -> Settings | None:
        if self.against:
            return None
        return {one.axis.name: one.best for one in self.parameters}


@dataclass(frozen=True)
class Wish:
    """What to search: see ``hil tune ekf --help``."""

    recordings: Sequence[Path] = ()
    held: Sequence[Path] = ()
    hold_out: int | None = None
    sets: int = 0
    parameters: Sequence[str] = ()
    trials: int = 100
    seed: int = 0
    folder: Path | None = None
    jobs: int = 1
    scheduler: str | None = None


def tune(wish: Wish, progress: Progress | None = None) -> Tuned:
    """Search, look around the best, and judge it on what was held out.

    Raises:
        RecordingError: too few recordings, or one that no estimator can be run on.
        ParameterError: a range that is none.
        RigError: the cluster cannot be had, or workers die.
    """
    tell = progress or (lambda _share, _what: None)
    tell(0.0, "reading")
    training, held = parts(wish, *_read(wish))
    cases = [one for source in (*training, *held) for one in source.cases]
    own = sum(len(source.cases) for source in training)
    axes = parse(cases[0].run.params, wish.parameters)
    with workers(wish.jobs, wish.scheduler) as crew:
        crew.share(cases)
        bench = _Bench(cases, crew, wish.folder, tell)
        return _tune(bench, own, axes, wish)


def parts(
    wish: Wish, given: Sequence[Source], held: Sequence[Source]
) -> tuple[list[Source], list[Source]]:
    """Sources to search on and to judge on; copies of one are never on both sides.

    Raises:
        RecordingError: too few of them, or one on both sides.
    """
    both = {one.digest for one in given} & {one.digest for one in held}
    for one in (*given, *held):
        if one.digest in both:
            raise RecordingError(
                f"{one.name} is to be searched on and held out", "hold out another recording"
            )
    distinct = sorted({one.digest for one in given})
    if held:
        if not given:
            raise RecordingError("every recording is held out", "name some to search on")
        return list(given), list(held)
    count = wish.hold_out if wish.hold_out is not None else max(1, len(distinct) // 4)
    if count >= len(distinct):
        raise RecordingError(
            f"{len(distinct)} different recordings, {count} of them to hold out: none is left",
            "name more recordings, or add simulated sets: --sets 8",
        )
    chosen = np.random.default_rng(wish.seed).permutation(len(distinct))[:count]
    out = {distinct[int(k)] for k in chosen}
    return (
        [one for one in given if one.digest not in out],
        [one for one in given if one.digest in out],
    )


def _read(wish: Wish) -> tuple[list[Source], list[Source]]:
    files = [library.resolve(path) for path in (*wish.recordings, *wish.held)]
    if not files and not wish.sets:
        raise RecordingError("no recording to tune on", "name some, or add sets: --sets 8")
    read = [
        Source(file.parent.name, cases)
        for file, cases in zip(
            files, locally(wish.jobs, case.of_recording, files) if files else (), strict=True
        )
    ]
    which = [(SEED_FIRST + k // 2, bool(k % 2)) for k in range(wish.sets)]
    made = [Source(one.name, [one]) for one in (locally(wish.jobs, _set, which) if which else ())]
    given = len(wish.recordings)
    return [*read[:given], *made], read[given:]


def _set(which: tuple[int, bool]) -> Case:
    return case.of_seed(*which)


class _Bench:
    """Evaluates choices of parameters on cases, each once, and keeps what it found."""

    def __init__(
        self, cases: Sequence[Case], crew: Workers, folder: Path | None, tell: Progress
    ) -> None:
        self.cases, self.tell = cases, tell
        self._crew, self._folder = crew, folder
        self.now: list[Figures] = []
        self.done, self.total, self.what = 0, 1, ""

    def figures(self, several: Sequence[Settings], which: range) -> list[list[Figures]]:
        """Of each choice, on each of the cases ``which``."""
        chunks = [several[k : k + TOGETHER] for k in range(0, len(several), TOGETHER)]
        asked = [(k, chunk) for chunk in chunks for k in which]
        keys = [kept.digest(self.cases[k].digest, json.dumps(chunk)) for k, chunk in asked]
        found = [self._before(key, chunk) for key, (_, chunk) in zip(keys, asked, strict=True)]
        missing = [n for n, one in enumerate(found) if one is None]
        self._advance(len(asked) - len(missing))
        results = self._crew.map(evaluate, [asked[n] for n in missing])
        for n, result in zip(missing, results, strict=True):
            found[n] = result
            if self._folder is not None:
                kept.write(self._folder, "ekf", keys[n], result)
            self._advance(1)
        return [
            [(found[c * len(which) + i] or [])[j] for i in range(len(which))]
            for c, chunk in enumerate(chunks)
            for j in range(len(chunk))
        ]

    def costs(self, several: Sequence[Settings], which: range) -> list[float]:
        """Mean cost of each choice over the cases ``which``, less that of now."""
        return [self.mean(one, which) for one in self.figures(several, which)]

    def mean(self, figures: Sequence[Figures], which: range) -> float:
        found = [
            self.cost(k, f) - self.cost(k, self.now[k]) for k, f in zip(which, figures, strict=True)
        ]
        return math.fsum(found) / len(found)

    def cost(self, k: int, figures: Figures) -> float:
        known = self.cases[k].known
        return cost(figures, self.now[k], known.rests if known else True)

    def _before(self, key: str, chunk: Sequence[Settings]) -> list[Figures] | None:
        if self._folder is None:
            return None
        result = kept.read(self._folder, "ekf", key)
        sound = (
            isinstance(result, list)
            and len(result) == len(chunk)
            and all(
                isinstance(one, dict) and all(isinstance(x, float) for x in one.values())
                for one in result
            )
        )
        return result if sound else None

    def _advance(self, tasks: int) -> None:
        self.done += tasks
        self.tell(min(self.done / self.total, 1.0), self.what)


def _tune(bench: _Bench, own: int, axes: Sequence[Axis], wish: Wish) -> Tuned:
    every, training, held = range(len(bench.cases)), range(own), range(own, len(bench.cases))
    first = bench.cases[0].run.params
    now = {axis.name: float(getattr(first, axis.name)) for axis in axes}
    population = 4 + math.floor(3.0 * math.log(max(len(axes), 2)))
    generations = math.ceil(wish.trials / population)
    tasks = generations * math.ceil(population / TOGETHER)
    tasks += math.ceil(len(axes) * (len(CURVE) + 1) / TOGETHER)
    bench.total = tasks * own + 2 * len(every)
    bench.what = "as it is now"
    # Each with its own image's parameters, which need not be those of the first.
    bench.now = bench.figures([{}], every)[0]
    best, best_cost, trials = dict(now), 0.0, 0

    def costs_of(several: list[Settings]) -> list[float]:
        return bench.costs(several, training)

    for asked, costs in _generations(axes, now, costs_of, generations, wish.seed):
        trials += len(asked)
        least = int(np.argmin(costs))
        if costs[least] < best_cost:
            best, best_cost = asked[least], costs[least]
        bench.what = f"best so far {best_cost:+.4g}"
    bench.what = "around the best"
    parameters = _sensitivities(bench, training, axes, now, (best, best_cost))
    bench.what = "held out"
    with_best = bench.figures([best if best != now else {}], every)[0]
    scores = [
        Score(
            one.name,
            one.known is not None,
            bench.now[k],
            with_best[k],
            bench.cost(k, bench.now[k]),
            bench.cost(k, with_best[k]),
        )
        for k, one in enumerate(bench.cases)
    ]
    bench.tell(1.0, "")
    judged = _against(scores[:own], [scores[k] for k in held])
    return Tuned(scores[:own], scores[own:], parameters, trials, judged)


def _generations(
    axes: Sequence[Axis],
    now: Mapping[str, float],
    costs_of: Callable[[list[Settings]], list[float]],
    count: int,
    seed: int,
) -> Iterator[tuple[list[Settings], list[float]]]:
    """Choices asked for and their costs, one generation after the other."""
    start = [axis.share(now[axis.name]) for axis in axes]
    # CMA-ES wants two dimensions: a second one that nothing depends on.
    mean = np.array(start if len(start) > 1 else [*start, 0.5])
    bounds = np.tile([0.0, 1.0], (len(mean), 1))
    search = CMA(mean=mean, sigma=SIGMA, bounds=bounds, seed=seed)
    for _ in range(count):
        shares = [search.ask() for _ in range(search.population_size)]
        asked = [
            {axis.name: axis.at(float(x)) for axis, x in zip(axes, share, strict=False)}
            for share in shares
        ]
        costs = costs_of(asked)
        search.tell(list(zip(shares, costs, strict=True)))
        yield asked, costs
        if search.should_stop():
            break


def _sensitivities(
    bench: _Bench,
    which: range,
    axes: Sequence[Axis],
    now: Mapping[str, float],
    found: tuple[Settings, float],
) -> list[Sensitivity]:
    best, best_cost = found
    asked = [
        {**best, axis.name: value}
        for axis in axes
        for value in (*(axis.at(share) for share in CURVE), now[axis.name])
    ]
    costs = bench.costs(asked, which)
    width = len(CURVE) + 1
    result = []
    for k, axis in enumerate(axes):
        own = costs[k * width : (k + 1) * width]
        curve = sorted(
            {
                best[axis.name]: best_cost,
                **{axis.at(share): c for share, c in zip(CURVE, own, strict=False)},
            }.items()
        )
        result.append(
            Sensitivity(
                axis,
                now[axis.name],
                best[axis.name],
                [value for value, _ in curve],
                [c for _, c in curve],
                own[-1] - best_cost,
            )
        )
    return result


def _against(training: Sequence[Score], held: Sequence[Score]) -> str:
    """Why the best is not proposed; empty where it is."""
    if all(one.cost_best == one.cost_now for one in training):
        return "nothing better was found on the recordings that were searched"
    for one in held:
        for name in ("wrong", "false_zupt", "refused"):
            if one.best.get(name, 0.0) > one.now.get(name, 0.0):
                return f"on {one.name}, held out, it brings {NAMES[name]}"
    gains = np.array([one.cost_now - one.cost_best for one in held])
    error = float(gains.std(ddof=1) / math.sqrt(gains.size)) if gains.size > 1 else 0.0
    if not gains.mean() > error:
        return (
            f"on what was held out the cost changes by {-gains.mean():+.3g}, standard error "
            f"{error:.2g}: that is no improvement"
        )
    return ""


NAMES: Final = {
    "wrong": "repetitions missed or invented",
    "false_zupt": "zero-velocity updates on a moving bar",
    "refused": "no estimate at all",
}
