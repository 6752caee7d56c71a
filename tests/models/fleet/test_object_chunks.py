"""Chunks in an object storage are as those in a folder: same results, found again, and no credentials in them."""

from __future__ import annotations

import os

import numpy as np
import pytest

from models.fleet.object_store import ObjectStore
from models.work.errors import ChunksFailedError
from models.work.folder_store import FolderStore
from models.work.pool import SerialExecutor
from models.work.runner import Runner
from tests.models.work.tasks import Shared, leaks, scaled, work
from tests.support.object_storage import use_account

pytestmark = pytest.mark.cluster


def content(store):
    return {name: store.read(name) or b"" for name in store.names()}


def test_results_are_those_of_a_folder_and_are_found_again(storage, monkeypatch, tmp_path):
    use_account(storage.environment, monkeypatch)
    shared, tasks = Shared(2.5, np.arange(4.0)), [0.1 * number for number in range(7)]
    folder, bucket = FolderStore(tmp_path), ObjectStore(storage.url("chunks/equal"))
    found = {}
    for store in (folder, bucket):
        with Runner(SerialExecutor(), store, resume=True) as runner:
            found[store.url] = list(runner.run(work(scaled, 2), shared, tasks))
            assert (runner.tally.chunks, runner.tally.kept) == (4, 0)
    assert np.array_equal(found[folder.url], found[bucket.url])
    names = {name for name in folder.names() if name.startswith(("chunks/", "shared/"))}
    assert names == {name for name in bucket.names() if name.startswith(("chunks/", "shared/"))}
    done = sorted(name for name in names if name.startswith("chunks/"))
    bucket.delete(done[0])
    with Runner(SerialExecutor(), bucket, resume=True, keep=False) as runner:
        assert np.array_equal(list(runner.run(work(scaled, 2), shared, tasks)), found[folder.url])
        assert (runner.tally.chunks, runner.tally.kept) == (4, 3)
    assert content(bucket) == {}


def test_no_credentials_stand_in_logs_of_failures(storage, monkeypatch):
    use_account(storage.environment, monkeypatch)
    bucket = ObjectStore(storage.url("chunks/failed"))
    with (
        pytest.raises(ChunksFailedError) as caught,
        Runner(SerialExecutor(), bucket, keep=False) as runner,
    ):
        list(runner.run(work(leaks), "https://name:planted@host/x?X-Amz-Signature=0123456789abcdef", [1]))
    told = [str(caught.value), repr(runner.tally)]
    logs = [data for name, data in content(bucket).items() if not name.startswith("shared/")]
    assert len(list(bucket.names("failed/"))) == 3
    everything = "".join(told).encode() + b"".join(logs)
    assert b"cannot open https://***@host/x?X-Amz-Signature=***" in everything
    for secret in (os.environ["AWS_SECRET_ACCESS_KEY"], "planted", "0123456789abcdef", *storage.secrets()):
        assert secret.encode() not in everything
