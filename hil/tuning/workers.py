# SPDX-License-Identifier: Apache-2.0
"""Where a tuner's evaluations run: in this process, in processes of this machine, on a cluster.

All three give results in the order of the tasks, so what is computed from them does not depend on
how many workers there are or which is the fastest. Inputs are sent to each worker once.

A Dask scheduler and its workers are trusted as one's own processes are: messages between them are
pickled. Nothing but this package's own functions, arrays and numbers goes out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from importlib import import_module
from types import TracebackType
from typing import Any, Final, Protocol, Self

from hil.errors import RigError
from hil.process.pool import pool
from hil.tuning import kept

Function = Callable[..., Any]
Task = tuple[int, Any]
"""Number of the input, and what else the function takes."""

CONNECT_S: Final = 20.0
ALONE_S: Final = 60.0
"""A cluster without a single worker for so long is given up."""


class Workers(Protocol):
    """Something that runs ``function(inputs[k], argument)``."""

    def share(self, inputs: Sequence[Any]) -> None:
        """Let every worker have these inputs; those before are forgotten."""

    def map(self, function: Function, tasks: Sequence[Task]) -> Iterator[Any]:
        """Results in the order of ``tasks``, each as soon as it and those before are there."""


@contextmanager
def workers(jobs: int = 1, scheduler: str | None = None) -> Iterator[Workers]:
    """``jobs`` processes of this machine, or the Dask cluster at an address.

    Raises:
        RigError: there is no Dask, no such scheduler, or its workers have another ``hil``.
    """
    if scheduler is not None:
        with _dask(scheduler) as cluster:
            yield cluster
    elif jobs <= 1:
        yield _Here()
    else:
        with _Pool(jobs) as here:
            yield here


def locally(jobs: int, function: Function, items: Sequence[Any]) -> Iterator[Any]:
    """``function(item)`` in order, in processes of this machine: where the files are."""
    with workers(min(jobs, len(items))) as here:
        here.share([function])
        yield from here.map(_apply, [(0, item) for item in items])


def _apply(function: Function, item: Any) -> Any:
    return function(item)


class _Here:
    def __init__(self) -> None:
        self._inputs: Sequence[Any] = ()

    def share(self, inputs: Sequence[Any]) -> None:
        self._inputs = inputs

    def map(self, function: Function, tasks: Sequence[Task]) -> Iterator[Any]:
        return (function(self._inputs[k], argument) for k, argument in tasks)


_INPUTS: Sequence[Any] = ()
"""Of this process, if it is one of a pool."""


def _take(inputs: Sequence[Any]) -> None:
    global _INPUTS  # noqa: PLW0603 (a worker process has one tuner)
    _INPUTS = inputs


def _run(function: Function, task: Task) -> Any:
    return function(_INPUTS[task[0]], task[1])


class _Pool:
    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._pool: ProcessPoolExecutor | None = None
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._stack.__exit__(kind, error, traceback)

    def share(self, inputs: Sequence[Any]) -> None:
        self._stack.close()
        self._pool = self._stack.enter_context(
            pool(self._jobs, initializer=_take, initargs=(inputs,))
        )

    def map(self, function: Function, tasks: Sequence[Task]) -> Iterator[Any]:
        assert self._pool is not None, "share the inputs first"
        waiting = [self._pool.submit(_run, function, task) for task in tasks]
        try:
            for one in waiting:
                yield one.result()
        except BrokenProcessPool as error:
            raise RigError(
                "a worker process died: out of memory, or killed",
                "start again with fewer --jobs; with --keep it goes on where it was",
            ) from error


class _Dask:
    def __init__(self, client: Any) -> None:
        self._client = client
        self._inputs: list[Any] = []

    def share(self, inputs: Sequence[Any]) -> None:
        # Not by their content: two inputs that look the same to Dask are still two.
        self._inputs = self._client.scatter(list(inputs), broadcast=True, hash=False)

    def map(self, function: Function, tasks: Sequence[Task]) -> Iterator[Any]:
        waiting = [
            self._client.submit(function, self._inputs[k], argument, pure=False)
            for k, argument in tasks
        ]
        for one in waiting:
            yield self._result(one)

    def _result(self, one: Any) -> Any:
        killed = import_module("distributed").KilledWorker
        alone = 0.0
        while True:
            try:
                return one.result(timeout=5.0)
            except TimeoutError:
                present = self._client.scheduler_info().get("workers", {})
                alone = 0.0 if present else alone + 5.0
                if alone >= ALONE_S:
                    raise RigError(
                        f"the Dask cluster has had no worker for {ALONE_S:.0f} s",
                        "start workers: dask worker ADDRESS; with --keep the tuner goes on",
                    ) from None
            except killed as error:
                raise RigError(
                    f"evaluations kill the workers of the Dask cluster: {error}",
                    "look at the workers' logs; give them more memory",
                ) from error


def _their_version() -> str:
    return kept.version()


@contextmanager
def _dask(address: str) -> Iterator[_Dask]:
    try:
        distributed: Any = import_module("distributed")
    except ImportError as error:
        raise RigError("--dask needs the package distributed", "pip install 'hil[dask]'") from error
    try:
        client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise RigError(
            f"no Dask scheduler at {address}: {error}",
            "start one: dask scheduler; its address is in its log, e.g. tcp://10.0.0.5:8786",
        ) from error
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
        theirs = client.run(_their_version)
        others = sorted(name for name, version in theirs.items() if version != kept.version())
        if others:
            raise RigError(
                f"another hil, or another estimator, runs on {', '.join(others[:4])}",
                "install the same hil on every worker, then start the workers again",
            )
        yield _Dask(client)
    except TimeoutError as error:
        raise RigError(
            f"the Dask scheduler at {address} has no workers", f"start some: dask worker {address}"
        ) from error
    except ModuleNotFoundError as error:
        raise RigError(
            f"the Dask workers cannot import {error.name}",
            "install the same hil on every worker, then start the workers again",
        ) from error
    finally:
        client.close(timeout=5.0)
