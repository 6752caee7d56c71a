"""Workers that answer what they should not: each chunk fails with words, no run hangs, and the next one is right."""

from __future__ import annotations

import pytest

from models.work.errors import ChunksFailedError
from models.work.runner import Runner
from tests.models.fleet import jobs
from tests.models.work import tasks

pytestmark = pytest.mark.cluster
_NO_OUTCOME = "a worker answered with {}, not with its outcome"
ANSWERS = {
    "nothing": _NO_OUTCOME.format("NoneType"),
    "another kind": _NO_OUTCOME.format("dict"),
    "giant": _NO_OUTCOME.format("bytes"),
    "another chunk": _NO_OUTCOME.format("ChunkOutcome"),
    "no results": "has no results of naps 1, which a worker wrote",
    "too few results": "naps 1 has 0 results of 1 tasks",
    "unreadable": "not unpickled",
    "raises": "Unreadable",
}


@pytest.mark.parametrize("how", ANSWERS)
def test_what_a_worker_may_answer_fails_its_chunk_and_no_other_run(how, cluster, executor, store):
    client = cluster.connect()
    try:
        client.run(jobs.misbehave, how)
        with pytest.raises(ChunksFailedError) as caught:
            list(Runner(executor, store).run(tasks.work(jobs.naps), 0.0, range(3)))
        client.run(jobs.misbehave, "")
    finally:
        client.close()
    assert ANSWERS[how] in str(caught.value)
    assert list(Runner(executor, store).run(tasks.work(jobs.naps), 0.0, range(3))) == [0, 1, 2]
