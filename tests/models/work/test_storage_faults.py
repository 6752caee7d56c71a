"""Object storage that fails: faults of the moment are overcome, others end a run with one line, and nothing is lost."""

from __future__ import annotations

import pytest

from models.fleet.object_store import ObjectStore
from models.work.errors import ObjectStorageError
from models.work.pool import SerialExecutor
from models.work.redact import redact
from models.work.runner import Runner
from streams.files.remote import RemoteError, expand, fetched
from streams.types.spec import SourceError
from tests.models.work.tasks import Shared, scaled, work
from tests.support.effort import effort_count
from tests.support.faulty_storage import TRANSIENT, Fault, at_random, faulty_storage, no_fault, without_pauses
from tests.support.object_storage import use_account

pytestmark = pytest.mark.cluster

FILES = {f"run/{number:02}.npy": bytes([number]) * 1000 for number in range(3)}
TASKS = [0.1 * number for number in range(8)]
MOMENTARY = (*TRANSIENT[3:7], *TRANSIENT[: effort_count(quick=1, full=3)])
assert {fault.how for fault in MOMENTARY} == {"refuse", "reset", "cut", "lose", "damage"}


@pytest.fixture(scope="module")
def proxy(storage):
    with pytest.MonkeyPatch.context() as patch, faulty_storage(storage.port) as found:
        without_pauses(patch)
        use_account({**storage.environment, "AWS_ENDPOINT_URL": found.endpoint}, patch)
        yield found


@pytest.fixture
def faulty(proxy):
    proxy.begin()
    return proxy


def fault_name(fault):
    return fault.how if fault.how != "refuse" else fault.code


@pytest.mark.parametrize("fault", MOMENTARY, ids=fault_name)
def test_faults_of_the_moment_are_overcome(fault, faulty, storage, tmp_path):
    store = ObjectStore(storage.url(f"moment/{fault_name(fault)}"))
    faulty.rule = lambda request: fault if request.times <= 2 else None
    for name, data in FILES.items():
        store.write(name, data)
    assert sorted(store.names()) == sorted(FILES)
    assert store.read("run/02.npy") == FILES["run/02.npy"]
    with fetched(expand(f"{store.url}/r*")[0], tmp_path) as recording:
        assert {f"run/{path.name}": path.read_bytes() for path in recording.path.iterdir()} == FILES
    store.delete("run/02.npy")
    assert store.read("run/02.npy") is None
    assert faulty.faults[fault_name(fault)] > len(FILES)


LASTING = (
    (Fault("refuse", 503, "SlowDown"), "SlowDown: made by a test"),
    (Fault("refuse", 500, "InternalError"), "InternalError: made by a test"),
    (Fault("refuse", 403, "ExpiredToken"), "ExpiredToken: made by a test"),
    (Fault("refuse", 403, "AccessDenied"), "AccessDenied: made by a test"),
    (Fault("refuse", 404, "NoSuchBucket"), "NoSuchBucket: made by a test"),
    (Fault("refuse", 301, "PermanentRedirect"), "the endpoint redirects requests; expected its own address and region"),
    (Fault("reset"), "ConnectionClosedError: Connection was closed"),
)
LIKE_ABSENCE = ("NoSuchBucket", "AccessDenied")
"""Refusals that could be taken for an object or a listing of nothing: all actions are tried."""


@pytest.mark.parametrize(("fault", "words"), LASTING, ids=[fault_name(fault) for fault, _ in LASTING])
def test_lasting_faults_are_one_line_with_url_and_cause(fault, words, faulty, storage, tmp_path):
    store = ObjectStore(storage.url("lasting"))
    faulty.rule = lambda request: fault
    actions = {
        f"{store.url}/a cannot be read: ": lambda: store.read("a"),
        f"{store.url}/a cannot be written: ": lambda: store.write("a", b"1"),
        f"{store.url}/a cannot be listed: ": lambda: list(store.names("a")),
        f"{store.url}/a cannot be deleted: ": lambda: store.delete("a"),
        f"{store.url}/r* cannot be listed: ": lambda: expand(f"{store.url}/r*"),
        f"{store.url}/run cannot be listed: ": lambda: fetched(f"{store.url}/run", tmp_path).__enter__(),
    }
    for begin, action in list(actions.items())[:: 1 if fault.how == "refuse" and fault.code in LIKE_ABSENCE else 5]:
        with pytest.raises((ObjectStorageError, RemoteError, SourceError)) as caught:
            action()
        message = str(caught.value)
        assert message.startswith(f"{begin}{words}")
        assert len(message.splitlines()) == 1
        assert not [secret for secret in storage.secrets() if secret in message]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("how", ["shorten", "cut"])
def test_a_part_of_a_recording_is_never_taken_for_the_whole(how, faulty, storage, tmp_path):
    store = ObjectStore(storage.url(f"part/{how}"))
    store.write("run/a.npy", b"0123456789" * 100)
    faulty.rule = lambda request: Fault(how) if request.method == "GET" and request.path.endswith(".npy") else None
    with pytest.raises(RemoteError, match=r"(changed while it was|cannot be) fetched"):
        fetched(f"{store.url}/run", tmp_path).__enter__()
    assert not list(tmp_path.iterdir())


def test_a_run_ends_right_while_a_third_of_the_requests_fail(faulty, storage):
    faulty.rule = at_random(23, 0.33)
    with Runner(SerialExecutor(), ObjectStore(storage.url("third")), keep=False) as runner:
        found = list(runner.run(work(scaled, 2), Shared(2.0), TASKS))
        assert (runner.tally.chunks, runner.tally.failed) == (4, [])
    assert [result[0] for result in found] == [2.0 * task for task in TASKS]
    assert sum(faulty.faults.values()) > 5


@pytest.mark.parametrize("method", ["GET", "PUT"])
def test_a_storage_that_is_lost_ends_a_run_with_one_line_and_resume_finishes_it(method, faulty, storage):
    """Not chunk after chunk set aside: where the caller is refused too, no worker can be right."""
    store = ObjectStore(storage.url(f"lost/{method}"))
    done = []
    lost = Fault("refuse", 403, "ExpiredToken")

    def rule(request):
        return lost if len(done) >= 4 and request.method == method else None

    faulty.rule = rule
    with Runner(SerialExecutor(), store) as runner, pytest.raises(ObjectStorageError) as caught:
        done.extend(runner.run(work(scaled, 2), Shared(2.0), TASKS))
    assert runner.tally.failed == []
    message = str(caught.value)
    assert "cannot be" in message
    assert "ExpiredToken: made by a test" in message
    assert len(message.splitlines()) == 1
    faulty.rule = no_fault
    with Runner(SerialExecutor(), store, resume=True, keep=False) as runner:
        found = list(runner.run(work(scaled, 2), Shared(2.0), TASKS))
        assert runner.tally.kept >= 2
    assert [result[0] for result in found] == [2.0 * task for task in TASKS]
    assert list(store.names()) == []
    assert redact(message) == message


def page(names, token):
    entries = "".join(
        f"<Contents><Key>{name}</Key><LastModified>2026-03-01T00:00:00.000Z</LastModified><ETag>&quot;0&quot;</ETag>"
        f"<Size>3</Size></Contents>"
        for name in names
    )
    more = f"<NextContinuationToken>{token}</NextContinuationToken>" if token else ""
    text = f"<IsTruncated>{str(token is not None).lower()}</IsTruncated>{more}{entries}"
    return f'<?xml version="1.0" encoding="UTF-8"?><ListBucketResult>{text}</ListBucketResult>'.encode()


LISTINGS = {
    "the same token": (lambda n: (["evil/run/a.npy"], "one"), "lists the same again and again"),
    "the same names": (lambda n: (["evil/run/a.npy"], f"t{n}"), "lists the same again and again"),
    "no names": (lambda n: ([], "one"), "lists the same again and again"),
    "no token": (lambda n: (["evil/run/a.npy"], ""), "says that names are missing, but no token"),
    "no end": (lambda n: ([f"evil/run/{n}-{i}.npy" for i in range(9)], f"t{n}"), "lists more than 50 names"),
    "another prefix": (lambda n: (["other/secret.npy"], None), "lists 'other/secret.npy', expected names that begin"),
}


@pytest.mark.parametrize("kind", LISTINGS)
def test_a_listing_that_no_bucket_has_ends_with_one_line(kind, faulty, storage, tmp_path, monkeypatch):
    monkeypatch.setattr("models.work.filesystem.MAX_HELD_NAMES", 50)
    monkeypatch.setattr("models.fleet.object_store._MAX_NAMES", 50)
    answer, words = LISTINGS[kind]
    faulty.rule = lambda request: Fault("answer", body=page(*answer(faulty.requests)))
    for action in (
        lambda: list(ObjectStore(storage.url("evil")).names("run")),
        lambda: fetched(storage.url("evil/run"), tmp_path).__enter__(),
        lambda: expand(storage.url("evil/run/*")),
    ):
        with pytest.raises((ObjectStorageError, RemoteError), match=words) as caught:
            action()
        assert str(caught.value).startswith(storage.url("evil/run"))
        assert len(str(caught.value).splitlines()) == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["../../out.npy", "a/../b.npy", "a\\b.npy", ".."])
def test_a_key_that_leads_out_of_the_folder_is_not_fetched(name, faulty, storage, tmp_path):
    faulty.rule = lambda request: Fault("answer", body=page([f"evil/run/{name}"], None))
    with pytest.raises(SourceError, match=r"cannot be that of a file|no such object, and none below"):
        fetched(storage.url("evil/run"), tmp_path).__enter__()
    assert not list(tmp_path.iterdir())


def test_an_object_that_is_more_than_was_listed_does_not_fill_the_disk(faulty, storage, tmp_path):
    store = ObjectStore(storage.url("evil"))
    store.write("run/a.npy", b"x" * 5_000_000)

    def rule(request):
        listed = request.method == "GET" and "list-type" in request.query
        return Fault("answer", body=page(["evil/run/a.npy"], None)) if listed else None

    faulty.rule = rule
    with pytest.raises(
        RemoteError, match=r"a\.npy: changed while it was fetched \(3 bytes before, at least \d{1,6} came"
    ):
        fetched(storage.url("evil/run"), tmp_path).__enter__()
    assert not list(tmp_path.iterdir())


def test_an_object_that_is_replaced_between_list_and_read_is_no_recording(faulty, storage, tmp_path):
    store = ObjectStore(storage.url("replaced"))
    store.write("run/a.npy", b"before")

    def rule(request):
        if request.method == "GET" and request.path.endswith(".npy") and request.times == 1:
            store.write("run/a.npy", b"after!")

    faulty.rule = rule
    with pytest.raises(RemoteError, match=r"a\.npy: changed while it was fetched"):
        fetched(storage.url("replaced/run"), tmp_path).__enter__()
