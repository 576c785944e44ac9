# SPDX-License-Identifier: Apache-2.0
"""Where evaluations run: the same answers here, in processes and on a cluster, or a clear error."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from hil.errors import RigError
from hil.tuning import ekf_show, heatmap, kept, zupt
from hil.tuning import workers as crews
from hil.tuning.grid import around
from hil.tuning.workers import locally, workers

distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")

RECORDINGS = Path(__file__).parents[3] / "fixtures/recordings"


@pytest.fixture(scope="module")
def cluster():
    """Two workers in processes of their own, as on other machines: they have no files of ours."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", host="127.0.0.1"
    ) as found:
        yield found.scheduler_address


def test_two_dask_workers_come_to_the_answer_of_the_pool(tuned, cluster):
    here, there = tuned(jobs=2), tuned(scheduler=cluster)
    assert here.proposal is not None
    for form in (ekf_show.parameters_csv, ekf_show.recordings_csv, ekf_show.svg):
        assert form(there) == form(here)


def test_counts_of_the_thresholds_are_those_of_the_pool(cluster, tmp_path):
    files = [RECORDINGS / name / "recording.mcap" for name in ("reconnect", "imu-rest")]
    grid = around(4e-4, 1.2e-4, 6)
    here = zupt.tune(files, grid)
    there = zupt.tune(files, grid, tmp_path, scheduler=cluster)
    again = zupt.tune(files, grid, tmp_path, scheduler=cluster)
    assert there.names == here.names == again.names
    for ours, theirs, once in zip(here.tables, there.tables, again.tables, strict=True):
        for name in kept.NAMES:
            assert np.array_equal(getattr(ours, name), getattr(theirs, name))
            assert np.array_equal(getattr(ours, name), getattr(once, name))
    assert len(list(tmp_path.glob("zupt-*.json"))) == 2
    # A map narrower than the name of its axis is drawn too.
    assert "zupt_gyro_var, (rad/s)^2" in heatmap.terminal(here, heatmap.spans(here), "").plain


def test_a_cluster_with_another_hil_is_refused(cluster, monkeypatch):
    # The workers were started before, and still have their own.
    monkeypatch.setattr(crews.kept, "version", lambda: "another")
    monkeypatch.setattr(crews, "_their_version", kept_version)
    with pytest.raises(RigError, match="another hil"), workers(scheduler=cluster):
        pass


def kept_version() -> str:
    return "theirs"


def test_no_scheduler_and_no_workers_are_clear_errors(monkeypatch):
    monkeypatch.setattr(crews, "CONNECT_S", 1.0)
    with (
        pytest.raises(RigError, match="no Dask scheduler at"),
        workers(scheduler="tcp://127.0.0.1:9"),
    ):
        pass
    with pytest.raises(RigError, match="no Dask scheduler at"), workers(scheduler="not an address"):
        pass
    with (
        distributed.LocalCluster(
            n_workers=0, processes=True, dashboard_address=":0", host="127.0.0.1"
        ) as empty,
        pytest.raises(RigError, match="has no workers"),
        workers(scheduler=empty.scheduler_address),
    ):
        pass


def test_without_dask_the_extra_is_named(monkeypatch):
    def absent(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(crews, "import_module", absent)
    with pytest.raises(RigError, match=r"hil\[dask\]"), workers(scheduler="tcp://127.0.0.1:1"):
        pass


def twice(x: int) -> int:
    return 2 * x


def die(_: int) -> None:
    os._exit(1)


def plus(x: int, y: int) -> int:
    return x + y


@pytest.mark.parametrize("jobs", [1, 3])
def test_results_come_in_the_order_of_the_tasks(jobs):
    assert list(locally(jobs, twice, range(7))) == [2 * k for k in range(7)]
    with workers(jobs) as crew:
        for inputs in ([10, 20], [30]):
            crew.share(inputs)
            tasks = [(k, y) for y in range(5) for k in range(len(inputs))]
            assert list(crew.map(plus, tasks)) == [inputs[k] + y for k, y in tasks]


def test_a_worker_that_dies_is_a_clear_error():
    with pytest.raises(RigError, match="a worker process died"):
        list(locally(2, die, range(4)))
