"""A store damaged in any way is opened again: what is saved is as it was committed, and what is lost is said."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from monitor.health.record import Record
from monitor.records import durable
from monitor.records.database import StoreError
from monitor.records.events import EventLog
from monitor.records.ledger import StoreLedger
from monitor.records.publish import publish
from monitor.records.recover import published as recover_published
from monitor.records.recover import salvage
from monitor.records.recover.salvage import SalvageReport, open_or_salvage
from monitor.records.store import Store
from streams.types.source import FileProgress
from tests.support.effort import effort_count
from tests.support.store_damage import PAGE, CutOff, CutOffError, zero

pytestmark = pytest.mark.process

SOURCES = ("s", "t")
BLOCKS = 260


def record(source: str, sequence: int) -> Record:
    values = {"rms": sequence / 7.0, "stage": "healthy", "bpfo_amplitude": [sequence / k for k in range(1, 7)]}
    return Record(
        source=source,
        sequence=sequence,
        name=f"{source}{sequence}.csv[1]",
        content_hash=f"{source}{sequence:08x}",
        time=1.7e9 + 5.0 * sequence,
        channels={"x": values, "y": values if sequence % 2 else {}},
        forecasts=({"channel": "x", "tt_s": float(sequence), "threshold_mm2": 0.05},) if sequence % 5 == 0 else (),
        events=({"kind": "tick", "channel": "x", "n": sequence},) if sequence % 3 == 0 else (),
    )


ALL = [record(source, sequence) for sequence in range(1, BLOCKS // 2 + 1) for source in SOURCES]


def states(item: Record) -> dict[str, dict[str, object]]:
    shared = {"seen": item.sequence, "values": [k / 3 for k in range(40)]}
    return {f"source:{item.source}": {"last": item.sequence}, f"channel:{item.source}:x": shared}


def progress(item: Record) -> FileProgress:
    return FileProgress(item.name, 100, 1, 1, "h", item.content_hash, 100, 10, "accepted")


def make(path: Path, *, closed: bool) -> None:
    """Make a store; where it is not closed, the latest commits are in its write-ahead log only."""
    whole = path.with_name("whole")
    with Store.open(whole, machine="m") as store, StoreLedger(store) as ledger:
        for item in ALL:
            assert store.commit(item, states(item)) == "committed"
            ledger.remember(item.source, [progress(item)])
        with EventLog(whole) as events:
            events.acknowledge("1", "operator", "seen", 1.8e9)
            events.notice(1.8e9, {"kind": "no_data", "channel": "x"})
        if not closed:
            for suffix in ("", "-wal"):
                shutil.copyfile(f"{whole}{suffix}", f"{path}{suffix}")
    if closed:
        shutil.copyfile(whole, path)


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> dict[bool, Path]:
    found: dict[bool, Path] = {}
    for closed in (False, True):
        found[closed] = tmp_path_factory.mktemp("stores") / "state.db"
        make(found[closed], closed=closed)
    return found


def copied(source: Path, folder: Path) -> Path:
    """Copy a store into an empty folder."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for suffix in ("", "-wal"):
        if Path(f"{source}{suffix}").exists():
            shutil.copyfile(f"{source}{suffix}", folder / f"state.db{suffix}")
    return folder / "state.db"


def check(path: Path, records_dir: Path | None = None) -> SalvageReport | None:
    """Open a store that may be damaged, and hold what it has against what was committed."""
    store, report = open_or_salvage(path, machine="m", records_dir=records_dir)
    with store:
        assert store.check() == []
        found = list(store.records())
        gone = [item for item in found if item.reason.startswith("its record was lost")]
        kept = [item for item in found if item not in gone]
        assert len({(item.source, item.sequence) for item in found}) == len(found)
        original = {(item.source, item.sequence): item for item in ALL}
        for item in gone:
            before = original[item.source, item.sequence]
            assert (item.status, item.content_hash, item.name) == ("unreadable", before.content_hash, before.name)
        different = sum(item != original.get((item.source, item.sequence)) for item in kept)
        assert different <= (0 if report is None else report.unchecked)
        if report is not None and report.aside is not None:
            assert report.saved == len(kept)
            assert sum(part.last - part.first + 1 for part in report.emptied) == len(gone)
            assert report.saved + report.lost <= len(ALL)
            lost = {(part.source, k) for part in report.missing for k in range(part.first, part.last + 1)}
            assert lost <= original.keys() - {(item.source, item.sequence) for item in found}
            assert path.with_name(report.aside.name).exists()
        last = {source: store.last(source) for source in SOURCES}
        for name, state in store.load_states().items():
            source = name.split(":")[1]
            # Older ones are taken on over the records since.
            of_block = int(state.get("last", state.get("seen", 0)))
            assert of_block <= last[source]
            assert state == states(record(source, of_block))[name]
        # The store goes on as any other.
        for source in SOURCES:
            item = record(source, last[source] + 1)
            assert store.commit(item, states(item)) == "committed"
            assert store.record(source, item.sequence) == item
    again, second = open_or_salvage(path, machine="m")
    again.close()
    assert second is None
    return report


def flip(data: bytearray, place: int, bits: int) -> None:
    data[place % len(data)] ^= bits


def garble(data: bytearray, place: int, bits: int) -> None:
    start = place % len(data) // PAGE * PAGE
    data[start : start + PAGE] = bytes((byte ^ bits) for byte in data[start : start + PAGE])


def truncate(data: bytearray, place: int, _: int) -> None:
    del data[place % len(data) :]


DAMAGES: tuple[Callable[[bytearray, int, int], None], ...] = (flip, zero, garble, truncate)
damages = st.lists(
    st.tuples(st.sampled_from(DAMAGES), st.integers(0, 1 << 24), st.integers(1, 255), st.booleans()),
    min_size=1,
    max_size=4,
)


@settings(
    max_examples=effort_count(quick=25, full=3000),
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(damage=damages, closed=st.booleans(), without_log=st.booleans())
@pytest.mark.timeout(effort_count(quick=900, full=7200))
def test_whatever_was_damaged_it_opens_and_what_is_saved_is_as_it_was_committed(
    stores: dict[bool, Path],
    tmp_path: Path,
    damage: list[tuple[Callable[[bytearray, int, int], None], int, int, bool]],
    closed: bool,
    without_log: bool,
) -> None:
    path = copied(stores[closed], tmp_path / "state")
    log = Path(f"{path}-wal")
    if without_log:
        log.unlink(missing_ok=True)
    for how, place, bits, in_log in damage:
        target = log if in_log and log.exists() else path
        data = bytearray(target.read_bytes())
        if data:
            how(data, place, bits)
        target.write_bytes(data)
    try:
        check(path)
    except StoreError as error:
        # Two words of the table meta say whose store it is and of which version: these are believed.
        refusals = ["belongs to machine", "was written with schema version"]
        # What begins as no database does, without a log that begins as one and without our tables, may be another
        # program's file; zeros are a lost page.
        ours = is_log(log) or not any(path.read_bytes()[:16])
        refusals += [] if ours else ["is not a database"]
        if not any(text in str(error) for text in refusals):
            raise


def is_log(path: Path) -> bool:
    """Return whether a file begins as a write-ahead log does (file format of SQLite, section 4.1)."""
    return path.exists() and path.read_bytes()[:4] in (b"\x37\x7f\x06\x82", b"\x37\x7f\x06\x83")


def test_a_first_page_of_zeros_beside_a_log_without_a_header_is_a_damaged_store(
    stores: dict[bool, Path], tmp_path: Path
) -> None:
    """Seen with full effort: the store was taken for a foreign file, and the monitor did not start."""
    path = copied(stores[False], tmp_path / "state")
    log = Path(f"{path}-wal")
    page, header = bytearray(path.read_bytes()), bytearray(log.read_bytes())
    zero(page, 0, 0)
    flip(header, 0, 1)
    path.write_bytes(page)
    log.write_bytes(header)
    report = check(path)
    assert report is not None
    assert report.aside is not None


def damaged(stores: dict[bool, Path], folder: Path) -> Path:
    """Copy a store of which the pages that know of one block's name are gone."""
    path = copied(stores[True], folder)
    data = bytearray(path.read_bytes())
    while (place := data.find(b"s100.csv[1]")) > 0:
        zero(data, place, 0)
    path.write_bytes(data)
    return path


def test_a_salvage_that_is_cut_off_anywhere_is_done_at_the_next_start(
    stores: dict[bool, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    as_it_was = damaged(stores, tmp_path / "other").read_bytes()
    ended = True
    place = 0
    while ended:
        place += 1
        path = damaged(stores, tmp_path / f"{place}")
        cut = CutOff(place)
        with monkeypatch.context() as patch:
            for name in ("put_in_place", "settle", "_close_for_good"):
                patch.setattr(salvage, name, cut.counted(getattr(salvage, name)))
            for name in ("sync_folder", "link_durably"):
                patch.setattr(durable, name, cut.counted(getattr(durable, name)))
            for name in ("replace", "unlink"):
                patch.setattr(Path, name, cut.counted(getattr(Path, name)))
            try:
                open_or_salvage(path, machine="m")[0].close()
                ended = False
            except CutOffError:
                pass
        before = [other.name for other in path.parent.glob("state.db.corrupt-*")]
        store, _ = open_or_salvage(path, machine="m")
        with store:
            assert store.check() == []
            kept = [item for item in store.records() if item.status != "unreadable"]
            assert set(map(repr, kept)) <= set(map(repr, ALL))
            assert len(kept) > 100
        aside = [other for other in path.parent.glob("state.db.corrupt-*") if not other.name.endswith("-wal")]
        assert len(aside) == 1, (place, before)
        assert aside[0].read_bytes() == as_it_was
        assert not list(path.parent.glob("state.db.salvag*"))
    assert place > 10


def test_what_was_lost_is_in_the_event_log(
    stores: dict[bool, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(salvage, "_BEAT_EVERY", 1000)
    path = damaged(stores, tmp_path / "state")
    beats: list[float] = []
    store, report = open_or_salvage(path, machine="m", clock=lambda: 1.9e9, beat=lambda: beats.append(0.0))
    store.close()
    assert report is not None
    assert report.aside is not None
    assert beats
    assert 0 < report.lost < len(ALL)
    with EventLog(path) as events:
        notice = next(item for _, item in events.notices() if item.body["kind"] == "store_salvaged")
        assert notice.utc == 1.9e9
        assert notice.body["lost"] == report.lost
        assert notice.open
        # What stood in the log before is there still.
        assert any(item.body["kind"] == "no_data" for _, item in events.notices())
        acknowledged = events.event("1")
        assert acknowledged is not None
        assert acknowledged.acknowledgements[0].note == "seen"
    for part in (str(report.lost), report.aside.name):
        assert part in report.text


@pytest.fixture(autouse=True)
def read_in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read published files in this process, which is faster."""
    monkeypatch.setattr(recover_published, "_in_child", lambda to, files, beat: recover_published.take_files(to, files))


@pytest.fixture(scope="module")
def published(stores: dict[bool, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("published")
    with Store.open(copied(stores[True], folder / "state"), read_only=True) as store:
        assert publish(store, folder / "records")
    return folder / "records"


def test_every_single_page_costs_nothing_where_the_records_are_published(
    stores: dict[bool, Path], published: Path, tmp_path: Path
) -> None:
    """Without them, a leaf costs what is on it, and a page above leaves what is below."""
    pages = stores[True].stat().st_size // PAGE
    costs = []
    for page in range(0, pages, effort_count(quick=max(2, pages // 4), full=1)):
        data = bytearray(stores[True].read_bytes())
        zero(data, page * PAGE, 0)
        alone = check(copied_damage(data, tmp_path / "alone")) if page else None
        report = check(copied_damage(data, tmp_path / "state"), published)
        assert report is not None
        assert (report.saved, report.lost) == (len(ALL), 0)
        if alone is not None:
            # Without its schema SQLite reads nothing, and says so.
            assert alone.saved + alone.lost == len(ALL) or "no record in the old store can be read" in alone.text
            costs.append(len(ALL) - alone.saved)
    assert min(costs) < 90


def test_what_the_store_lost_and_a_published_file_has_comes_back_bit_for_bit(
    stores: dict[bool, Path], published: Path, tmp_path: Path
) -> None:
    for where in (b"s100.csv[1]", b'"tt_s": 90.0'):
        data = bytearray(stores[True].read_bytes())
        while (place := data.find(where)) > 0:
            zero(data, place, 0)
        without = check(copied_damage(data, tmp_path / "without"))
        assert without is not None
        report = check(copied_damage(data, tmp_path / "with"), published)
        assert report is not None
        assert report.lost == 0 < without.lost
        assert report.restored >= without.lost
        with Store.open(tmp_path / "with" / "state.db", read_only=True) as store:
            assert [found for found in store.records() if found in ALL] == list(store.records())[: len(ALL)]


def test_a_published_file_that_is_damaged_too_restores_nothing(
    stores: dict[bool, Path], published: Path, tmp_path: Path
) -> None:
    data = bytearray(stores[True].read_bytes())
    while (place := data.find(b"s100.csv[1]")) > 0:
        zero(data, place, 0)
    other = tmp_path / "records"
    other.mkdir()
    (other / "m-20231114.nc").write_bytes(b"damaged, too")
    report = check(copied_damage(data, tmp_path / "all"), other)
    assert report is not None
    assert report.restored == 0 < report.lost
    assert report.unreadable == ("m-20231114.nc",)


def copied_damage(data: bytes | bytearray, folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    path = folder / "state.db"
    path.write_bytes(data)
    return path
