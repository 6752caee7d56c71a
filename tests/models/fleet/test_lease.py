"""Leases in an object storage: one holder, one that is overtaken, one whose answers are lost."""

from __future__ import annotations

import uuid
from datetime import UTC, datetime

import pytest

from models.fleet.lease import LEASE_NAME, Holder, LeaseHeldError, LeaseLostError, Times, leased
from models.fleet.object_store import ObjectStore, age_of
from models.work.errors import ObjectStorageError
from tests.support.faulty_storage import Fault, faulty_storage, without_pauses
from tests.support.object_storage import use_account

pytest.importorskip("fsspec", reason="needs the extra cluster")

QUIET = Times(renew_s=1000.0, stale_s=1000.0, poll_s=0.001)
"""Nothing happens by itself."""
BUSY = Times(renew_s=0.005, stale_s=1000.0, poll_s=0.001)
IMPATIENT = Times(renew_s=1000.0, stale_s=0.01, poll_s=0.001)
OTHER = Holder("other", "far", 7, "2026-01-01T00:00:00+00:00")


def memory() -> ObjectStore:
    return ObjectStore(f"memory://{uuid.uuid4()}")


@pytest.fixture
def proxy(storage, monkeypatch):
    with faulty_storage(storage.port) as found:
        without_pauses(monkeypatch)
        use_account({**storage.environment, "AWS_ENDPOINT_URL": found.endpoint}, monkeypatch)
        yield found


def read_holder(store: ObjectStore) -> Holder:
    found = store.read(LEASE_NAME)
    assert found is not None
    return Holder.of(found)


def test_a_second_holder_is_refused_by_the_first_ones_name_and_the_lease_ends_with_the_block():
    store = memory()
    said: list[str] = []
    with leased(store, said.append, BUSY) as lease:
        mine = read_holder(store)
        assert mine.token == lease.token
        with pytest.raises(LeaseHeldError) as caught, leased(store, said.append, BUSY):
            pytest.fail("held twice")
        assert f"process {mine.pid} on {mine.host}, since {mine.since}" in str(caught.value)
        lease.confirm()
    assert list(store.names()) == []
    assert len(said) == 1
    assert "waiting up to 1000 s" in said[0]


def test_one_that_a_killed_process_left_is_taken_over_once_it_is_stale():
    store = memory()
    store.write(LEASE_NAME, OTHER.to_json())
    said: list[str] = []
    with leased(store, said.append, IMPATIENT) as lease:
        assert read_holder(store).token == lease.token
    assert "held by process 7 on far" in said[0]


def test_a_damaged_lease_becomes_stale_too():
    store = memory()
    store.write(LEASE_NAME, b"{")
    with leased(store, lambda _: None, IMPATIENT) as lease:
        lease.confirm()


@pytest.mark.parametrize("left", [OTHER.to_json(), None])
def test_who_was_overtaken_writes_no_more_and_leaves_the_other_ones_lease(left):
    store = memory()
    with leased(store, lambda _: None, QUIET) as lease:
        store.delete(LEASE_NAME)
        if left is not None:
            store.write(LEASE_NAME, left)
        lease.check()
        with pytest.raises(LeaseLostError, match="process 7 on far" if left else "was deleted"):
            lease.confirm()
        with pytest.raises(LeaseLostError):
            lease.check()
    assert store.read(LEASE_NAME) == left


def test_a_storage_that_fails_leaves_it_unknown_who_holds_it(monkeypatch):
    store = memory()
    with leased(store, lambda _: None, QUIET) as lease:
        with monkeypatch.context() as patch:

            def fail(*_):
                raise ObjectStorageError("no answer")

            patch.setattr(store, "read_kept", fail)
            with pytest.raises(ObjectStorageError):
                lease.confirm()
        lease.confirm()


def test_a_holder_that_ends_does_not_delete_the_lease_of_another(monkeypatch):
    """Even where it stands still between its question and the deletion."""
    store = memory()
    read = store.read_kept

    def overtaken(name):
        found = read(name)
        monkeypatch.setattr(store, "read_kept", read)
        store.write(LEASE_NAME, OTHER.to_json())
        return found

    with leased(store, lambda _: None, QUIET):
        monkeypatch.setattr(store, "read_kept", overtaken)
    assert read_holder(store) == OTHER


@pytest.mark.cluster
@pytest.mark.parametrize("code", [None, "NotImplemented", "PreconditionFailed"])
def test_an_object_is_deleted_where_it_is_as_it_was_read(code, proxy, storage):
    store = ObjectStore(storage.url(f"deleted/{uuid.uuid4()}"))
    tag = store.write_kept("a", b"1", None)
    assert tag is not None
    if code is not None:
        refused = Fault("refuse", 412 if code == "PreconditionFailed" else 501, code)
        proxy.rule = lambda request: refused if request.method == "DELETE" and request.times == 1 else None
    store.delete_kept("a", tag)
    assert store.read("a") == (b"1" if code == "PreconditionFailed" else None)
    store.delete_kept("a", tag)


@pytest.mark.parametrize("refused", [2, 1000])
def test_a_lease_is_lost_to_another_holder_alone(refused, monkeypatch):
    """S3 refuses a conditional request also because of another one at the same moment (409)."""
    monkeypatch.setattr("models.fleet.lease.PAUSES_S", (0.0, 0.0, 0.0))
    store = memory()
    with leased(store, lambda _: None, QUIET) as lease:
        with monkeypatch.context() as patch:
            write, left = store.write_kept, iter(range(refused))
            patch.setattr(store, "write_kept", lambda *given: write(*given) if next(left, None) is None else None)
            if refused == 2:
                lease.confirm()
            else:
                with pytest.raises(ObjectStorageError, match=r"lease\.json cannot be written: refused each time"):
                    lease.confirm()
        lease.confirm()
    assert store.read(LEASE_NAME) is None


@pytest.mark.cluster
def test_a_lease_is_held_while_requests_are_refused_because_of_others(proxy, storage, monkeypatch):
    monkeypatch.setattr("models.fleet.lease.PAUSES_S", (0.0, 0.0, 0.0))
    store = ObjectStore(storage.url(f"busy/{uuid.uuid4()}"))
    refused = Fault("refuse", 409, "ConditionalRequestConflict")
    with leased(store, lambda _: None, QUIET) as lease:
        left = iter(range(2))
        proxy.rule = lambda request: refused if request.method == "PUT" and next(left, None) is not None else None
        lease.confirm()
    assert proxy.faults["ConditionalRequestConflict"] == 2


@pytest.mark.parametrize(("date", "age"), [("Tue, 24 Nov 2026 17:00:30 GMT", 30.0), (None, None), ("yesterday", None)])
def test_the_age_is_by_the_clock_of_the_server(date, age):
    changed = datetime(2026, 11, 24, 17, tzinfo=UTC)
    headers = {} if date is None else {"date": date}
    assert age_of({"LastModified": changed, "ResponseMetadata": {"HTTPHeaders": headers}}) == age
    assert age_of({}) is None


@pytest.mark.cluster
def test_an_object_is_written_only_where_it_is_as_it_was_read(proxy, storage):
    store = ObjectStore(storage.url(f"kept/{uuid.uuid4()}"))
    assert store.read_kept("a") is None
    first = store.write_kept("a", b"1", None)
    assert first is not None
    assert store.write_kept("a", b"2", None) is None
    second = store.write_kept("a", b"3", first)
    assert second is not None
    assert store.write_kept("a", b"4", first) is None
    assert store.write_kept("b", b"5", first) is None
    found = store.read_kept("a")
    assert found is not None
    assert (found.data, found.tag) == (b"3", second)
    assert found.age_s is not None
    assert list(store.names()) == ["a"]


@pytest.mark.cluster
@pytest.mark.parametrize(
    "fault", [Fault("lose"), Fault("refuse", 409, "ConditionalRequestConflict")], ids=["lose", "409"]
)
def test_a_write_whose_answer_was_lost_is_known_as_its_own(fault, proxy, storage):
    store = ObjectStore(storage.url(f"lost/{uuid.uuid4()}"))
    proxy.rule = lambda request: fault if request.method == "PUT" and request.times == 1 else None
    written = fault.how == "lose"
    assert (store.write_kept("a", b"1", None) is not None) == written
    assert store.read("a") == (b"1" if written else None)


@pytest.mark.cluster
def test_a_lease_is_held_while_answers_are_lost(proxy, storage):
    store = ObjectStore(storage.url(f"lease/{uuid.uuid4()}"))
    proxy.rule = lambda request: Fault("lose") if request.method == "PUT" and request.times % 2 else None
    with leased(store, lambda _: None, QUIET) as lease:
        lease.confirm()
        lease.confirm()
        assert read_holder(store).renewals == 2
    assert proxy.faults["lose"] >= 3
    assert store.read(LEASE_NAME) is None


@pytest.mark.cluster
def test_a_server_without_conditions_is_asked_without_them(proxy, storage):
    store = ObjectStore(storage.url(f"plain/{uuid.uuid4()}"))
    refused = Fault("refuse", 501, "NotImplemented")
    proxy.rule = lambda request: refused if request.method == "PUT" and request.times == 1 else None
    with leased(store, lambda _: None, QUIET) as lease:
        assert read_holder(store).token == lease.token
