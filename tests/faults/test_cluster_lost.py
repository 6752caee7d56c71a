"""Workers, the scheduler and memory are lost while a cluster works: the results are those of one process."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from models.work.choose import open_runner
from models.work.task import DIED, Failure, Progress, Work
from tests.support.cluster_processes import ClusterProcesses, cluster_processes
from tests.support.cluster_tasks import LETHAL, exhaust, row
from tests.support.effort import effort_count

pytestmark = pytest.mark.cluster

ROWS = Work("rows", row, memory=10_000_000, per_chunk=2)
SHARED = np.linspace(0.0, 1.0, 8)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ClusterProcesses]:
    with cluster_processes(tmp_path_factory.mktemp("cluster"), ("w1", "w2"), memory="600MB") as processes:
        yield processes


def test_results_are_those_of_one_process_whatever_is_lost(cluster: ClusterProcesses, tmp_path: Path) -> None:
    tasks = range(60)
    events: dict[int, Callable[[], object]] = {
        4: cluster.workers["w1"].stop,
        8: lambda: cluster.add_worker("w3"),
        12: cluster.restart_scheduler,
        24: lambda: exhaust(cluster, "w2"),
    }
    left = dict(events)

    def notify(progress: Progress) -> None:
        for at in [at for at in left if progress.done >= at]:
            left.pop(at)()

    with open_runner(cluster=cluster.address, workers=2, chunks=tmp_path / "chunks", notify=notify) as runner:
        found = list(runner.run(ROWS, SHARED, tasks))
    assert left == {}
    assert np.array_equal(found, [row(SHARED, task) for task in tasks])
    assert cluster.scheduler.starts == 2
    assert "exceeded 95% memory budget" in (cluster.folder / "w2.log").read_text()
    assert [path for path in (tmp_path / "chunks").rglob("*") if path.is_file()] == []


@pytest.mark.skipif(effort_count(quick=1, full=0) == 1, reason="six seconds of restarting workers: full effort")
def test_a_chunk_whose_workers_die_is_set_aside_and_the_others_are_done(
    cluster: ClusterProcesses, tmp_path: Path
) -> None:
    tasks = [0, 1, LETHAL, 3, 4, 5]
    with open_runner(cluster=cluster.address, chunks=tmp_path / "chunks") as runner:
        found = dict(runner.outcomes(ROWS, SHARED, tasks))
        assert [aside.label for aside in runner.tally.failed] == ["rows 3 to 4"]
    died = {number: outcome for number, outcome in found.items() if isinstance(outcome, Failure)}
    assert {failure.kind for failure in died.values()} == {DIED}
    assert sorted(died) == [2, 3]
    for number in (0, 1, 4, 5):
        outcome = found[number]
        assert not isinstance(outcome, Failure)
        assert np.array_equal(outcome, row(SHARED, tasks[number]))
