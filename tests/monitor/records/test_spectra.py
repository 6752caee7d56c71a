"""Kept envelope spectra: enough of any life, the newest always, and the same rows however the blocks were taken."""

from __future__ import annotations

import math
import sqlite3
import threading
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.config.load import ConfigError
from monitor.health.signal.waterfall import SpectrumRow, WaterfallSettings, WaterfallState, step
from monitor.records.database import StoreError
from monitor.records.ledger import StoreLedger
from monitor.records.spectra import binned, in_orders, kept_blocks, pack_amplitude, read_spectra
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from monitor.service.replay import replay
from monitor.service.setup import source_settings
from reference.signals import bearing_lines
from streams.types.block import Block, Rejected
from tests.support.effort import effort_count
from tests.support.ingest import Queue
from tests.support.pipeline import FIRST_BAD, RATE, SPEED, life
from tests.support.records_spectra import START, blocks, machine, steps_of, take

LINES = bearing_lines("PRONOSTIA", SPEED)[1]


def table(path: Path) -> list[Any]:
    connection = sqlite3.connect(path)
    try:
        return connection.execute(
            "SELECT source, channel, sequence, time, kind, header, amplitude FROM spectra ORDER BY 1, 2, 3"
        ).fetchall()
    finally:
        connection.close()


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("undisturbed") / "state.db"
    with Store.open(path, machine="m") as store:
        take(store, steps_of(machine()), blocks())
    return path


def test_a_life_is_there_from_its_first_block_to_its_newest(undisturbed: Path) -> None:
    rows = read_spectra(undisturbed, "x")
    assert rows[0].sequence == 1
    assert rows[-1].sequence == 80
    assert [row.sequence for row in rows] == sorted({row.sequence for row in rows})
    assert 6 <= len(rows) <= 12 + 5
    assert kept_blocks(undisturbed, "x", source="s") == [(row.sequence, row.time) for row in rows]
    assert all(row.time == START + 10.0 * (row.sequence - 1) for row in rows)
    assert all(row.absolute and row.speed == SPEED and row.band == (500.0, 6000.0) for row in rows)


def test_what_is_kept_is_the_spectrum_of_that_block(undisturbed: Path) -> None:
    steps, made = steps_of(machine()), blocks()
    for item in made:
        steps.take(item)
        found = read_spectra(undisturbed, "x", at=item.sequence)
        output = steps.outputs["x"]
        if not found or output.features is None:
            continue
        (row,) = found
        envelope = output.features.envelopes[0]
        assert row.resolution == envelope.resolution
        assert row.mean == pytest.approx(envelope.mean, rel=1e-12)
        assert row.amplitude.size == int(6.5 * max(LINES.bpfo, LINES.bpfi, 2 * LINES.bsf) / envelope.resolution)
        np.testing.assert_allclose(row.amplitude, envelope.amplitude[: row.amplitude.size], rtol=2.0**-11)
        assert row.frequency[10] == 10 * row.resolution
        for fault, kinematic in (("outer", LINES.bpfo), ("inner", LINES.bpfi), ("cage", LINES.ftf)):
            assert row.lines[fault] == pytest.approx(kinematic, rel=0.021)


def test_spectra_around_the_start_of_the_final_stage_stay_for_good(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    config = machine(rows=1)
    with Store.open(path, machine="m") as store:
        steps = steps_of(config)
        take(store, steps, blocks())
        detector = steps.state.channels["x"].detect
        assert detector.t_fs is not None
        assert detector.t_fs_known is not None
        pinned = [row[2] for row in table(path) if row[4] == 2]
        assert pinned[0] < detector.t_fs.sequence
        assert pinned[1] == detector.t_fs_known.sequence >= FIRST_BAD
        assert len(pinned) >= 4
        # Everything else is thinned out to the least.
        assert len(table(path)) <= len(pinned) + 3


@pytest.mark.parametrize("batch", [2, 7, 64])
def test_batches_leave_the_rows_that_single_blocks_leave(tmp_path: Path, undisturbed: Path, batch: int) -> None:
    with Store.open(tmp_path / "state.db", machine="m") as store:
        take(store, steps_of(machine()), blocks(), batch)
    assert table(tmp_path / "state.db") == table(undisturbed)


@given(cuts=st.sets(st.integers(1, 79), max_size=6), lost=st.booleans())
@settings(max_examples=effort_count(quick=4, full=100))
def test_restarts_and_failed_commits_leave_the_same_rows(
    tmp_path_factory: pytest.TempPathFactory, undisturbed: Path, cuts: set[int], lost: bool
) -> None:
    path, made = tmp_path_factory.mktemp("cut") / "state.db", blocks()
    for first, last in zip([0, *sorted(cuts)], [*sorted(cuts), 80], strict=True):
        with Store.open(path, machine="m") as store:
            steps = steps_of(machine(), store.load_states())
            if lost:
                record = steps.take(made[first])
                with pytest.raises(ZeroDivisionError):
                    store.commit(record, steps.stored(), lambda _: print(1 / 0), steps.spectra)
                steps = steps_of(machine(), store.load_states())
            take(store, steps, made[first:last], 3)
    assert table(path) == table(undisturbed)


def test_the_live_way_leaves_the_same_rows(tmp_path: Path, undisturbed: Path) -> None:
    path, config = tmp_path / "state.db", machine()
    with Store.open(path, machine="m") as store, StoreLedger(store) as ledger:
        queue = Queue(store, list(blocks()))
        with Ingest(store, ledger, [queue], {"s": source_settings(config, config.source[0])}) as ingest:
            stop = threading.Event()
            while queue.waiting:
                ingest.step(stop)
    assert table(path) == table(undisturbed)


def test_replays_whole_and_in_pieces_leave_the_same_rows(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    for place, samples in enumerate(life(70)):
        (folder / f"{place:03d}.csv").write_text("a\n" + "\n".join(f"{value:.6g}" for value in samples) + "\n")
    config = machine(folder, interval=0.2)
    replay(config, None, tmp_path / "whole")
    for part, limit in enumerate((13, 40, 70)):
        replay(config, None, tmp_path / "parts", limit=limit, resume=part > 0)
    whole = table(tmp_path / "whole" / "state.db")
    assert whole == table(tmp_path / "parts" / "state.db")
    assert whole[-1][2] == 70
    assert len(whole) >= 6


def test_a_block_offered_again_changes_no_spectrum(tmp_path: Path) -> None:
    path, made = tmp_path / "state.db", blocks(12)
    with Store.open(path, machine="m") as store:
        steps = steps_of(machine())
        take(store, steps, made)
        before = table(path)
        other = steps_of(machine())
        take(store, other, [made[3], made[11]])
        assert table(path) == before


def test_bad_blocks_have_no_spectrum(tmp_path: Path) -> None:
    path, made = tmp_path / "state.db", blocks(20)
    flat = Block(np.zeros((1, 2560), np.float32), RATE, ("x",), ("m/s2",), "s", 21, "flat", start=START + 1000.0)
    late = Block(made[5].samples, RATE, ("x",), ("m/s2",), "s", 4, "late", start=START + 30.0)
    with Store.open(path, machine="m") as store:
        steps = steps_of(machine())
        take(store, steps, [*made[:3], *made[4:]])
        before = table(path)
        assert before[-1][2] == 20
        take(store, steps, [flat, late, Rejected("s", 22, "b", "nan", "bad"), Rejected("s", 23, "b", "short", "bad")])
        assert table(path) == before


def test_a_clock_that_is_not_believed_decides_nothing(tmp_path: Path) -> None:
    path, made = tmp_path / "state.db", blocks(30)
    wrong = Block(made[10].samples, RATE, ("x",), ("m/s2",), "s", 11, "b10", start=100.0)
    with Store.open(path, machine="m") as store:
        steps = steps_of(machine(rows=50, interval=20.0))
        take(store, steps, [*made[:10], wrong])
        assert table(path)[-1][2:5] == (11, START + 100.0, 0)
        take(store, steps, made[11:])
        times = [row[3] for row in table(path)[:-1]]
        assert min(times[1:][i] - times[i] for i in range(len(times) - 1)) >= 19.0
        assert 100.0 not in times


def test_blocks_without_any_time_are_kept_by_their_number(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    with Store.open(path, machine="m") as store:
        take(store, steps_of(machine()), blocks(30, start=None, elapsed=None))
        rows = read_spectra(store, "x")
    assert all(row.time is None for row in rows)
    assert 6 <= len(rows) <= 13
    assert rows[-1].sequence == 30


def test_none_are_kept_where_none_are_wanted(tmp_path: Path) -> None:
    with Store.open(tmp_path / "state.db", machine="m") as store:
        take(store, steps_of(machine(rows=0)), blocks(5))
        assert read_spectra(store, "x") == []
        assert not any(name.startswith("waterfall") for name in store.load_states())
    with pytest.raises(ConfigError, match="spectra"):
        machine(rows=-1)


def test_several_bands_keep_the_one_that_names_the_fault(tmp_path: Path) -> None:
    # The impacts of these signals ring within 500 to 6000 Hz.
    config = machine(band_hz=[[9000, 12000], [500, 6000]])
    with Store.open(tmp_path / "state.db", machine="m") as store:
        steps = steps_of(config)
        take(store, steps, blocks())
        assert steps.outputs["x"].naming is not None
        (row,) = read_spectra(store, "x", newest=1)
        assert row.band == steps.outputs["x"].bands[steps.outputs["x"].leading]
        first = read_spectra(store, "x")[0]
        assert first.band == (9000.0, 12000.0)


def test_an_older_store_gets_the_table_when_it_is_written_and_readers_do_without(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    Store.open(path, machine="m").close()
    with sqlite3.connect(path) as connection:
        connection.execute("DROP TABLE spectra")
    connection.close()
    assert read_spectra(path, "x") == []
    with Store.open(path, read_only=True) as store:
        assert read_spectra(store, "x") == []
        assert kept_blocks(store, "x") == []
    with Store.open(path, machine="m") as store:
        take(store, steps_of(machine()), blocks(3))
    assert [row.sequence for row in read_spectra(path, "x")][-1] == 3
    with pytest.raises(StoreError, match=r"none\.db"):
        read_spectra(tmp_path / "none.db", "x")


def test_a_part_of_the_rows_can_be_asked_for(undisturbed: Path) -> None:
    rows = [row.sequence for row in read_spectra(undisturbed, "x")]
    assert [row.sequence for row in read_spectra(undisturbed, "x", newest=3)] == rows[-3:]
    assert [row.sequence for row in read_spectra(undisturbed, "x", before=rows[4])] == rows[:4]
    assert [row.sequence for row in read_spectra(undisturbed, "x", before=rows[4], newest=1)] == [rows[3]]
    assert read_spectra(undisturbed, "x", at=100_000) == []
    assert read_spectra(undisturbed, "x", source="other") == []
    assert read_spectra(undisturbed, "y") == []


@given(
    steps=st.lists(st.floats(0.5, 500.0), min_size=1, max_size=400),
    rows=st.integers(1, 12),
    onset=st.integers(0, 400),
)
@settings(max_examples=effort_count(quick=24, full=2000))
def test_there_are_never_too_many_and_never_two_too_close(steps: list[float], rows: int, onset: int) -> None:
    plan = WaterfallSettings(rows=rows, interval=60.0)
    state, now = WaterfallState(), 0.0
    kept: list[float] = []
    pinned: list[float] = []
    for place, gap in enumerate(steps):
        now += gap
        state, kind, thin = step(state, now, plan, onset=place == onset)
        state = WaterfallState.from_dict(state.to_dict())
        if thin:
            kept = kept[::2]
        if kind == "kept":
            kept.append(now)
        elif kind == "pinned":
            pinned.append(now)
        assert len(kept) == state.count <= 2 * rows
        assert thin <= (len(kept) > rows)
        assert state.interval is not None
        assert all(later - earlier >= 0.99 * 60.0 for earlier, later in pairwise(kept))
        # No stretch of the life between two rows is longer than the while and what the blocks leave out.
        marks = sorted([*kept, *pinned])
        assert all(b - a <= 4.0 * state.interval + 2 * max(steps) for a, b in pairwise(marks))
    assert len(pinned) == 0 if onset >= len(steps) else 1 <= len(pinned) <= 3


def test_a_pin_is_not_thinned_and_the_last_before_it_is_found() -> None:
    state, kind, thin = step(WaterfallState(), 0.0, WaterfallSettings(rows=1), end=True)
    assert (kind, thin) == ("pinned", False)
    assert state.count == 0
    with pytest.raises(ValueError, match="waterfall state: version 1 expected, got 7"):
        WaterfallState.from_dict({"version": 7})


@given(
    values=st.lists(st.floats(0.0, 1e30), min_size=1, max_size=50),
    scale=st.sampled_from((1e-12, 1.0, 1e6)),
)
@settings(max_examples=effort_count(quick=40, full=5000))
def test_what_is_lost_by_halving_the_digits_is_as_stated(values: list[float], scale: float) -> None:
    amplitude = np.array(values) * scale
    packed, unit = pack_amplitude(amplitude)
    back = np.frombuffer(packed, dtype="<f2").astype(np.float64) * unit
    assert math.isfinite(unit)
    limit = np.maximum(2.0**-11 * amplitude, 1e-12 * amplitude.max())
    assert np.all(np.abs(back - amplitude) <= np.maximum(limit, 1e-33))


def row_of(amplitude: list[float], resolution: float) -> SpectrumRow:
    return SpectrumRow("s", "x", 1, 0.0, resolution, (0.0, 1.0), 1.0, 1.0, True, np.array(amplitude), {})


def test_over_orders_a_line_of_the_shaft_stays_in_its_bin_at_any_speed() -> None:
    rows = []
    for speed in (20.0, 25.0, 31.0):
        row = row_of([0.0] * 400, 0.25)
        row.amplitude[round(3.0 * speed / 0.25)] = speed
        rows.append(replace(row, speed=speed))
    assert in_orders(rows)
    assert not in_orders(rows[:1])
    assert in_orders([replace(rows[0], domain="order")])
    assert not in_orders([*rows, replace(rows[0], speed=0.0)])
    order, amplitude = binned(rows, 60, 5.0, orders=True)
    (place,) = set(np.nanargmax(amplitude, axis=1).tolist())
    assert order[place] <= 3.0 < order[place + 1]
    assert np.nanmax(amplitude, axis=1).tolist() == [20.0, 25.0, 31.0]
    # Over Hz they do not agree.
    assert len(set(np.nanargmax(binned(rows, 60)[1], axis=1).tolist())) == 3


def test_bins_of_a_picture_keep_every_line() -> None:
    rows = [row_of([0.0, 1.0, 5.0, 2.0, 0.0, 7.0], 2.0), row_of([0.0, 3.0, 4.0], 4.0)]
    frequency, amplitude = binned(rows, 3)
    assert frequency.tolist() == [0.0, 4.0, 8.0]
    assert amplitude.tolist() == [[1.0, 5.0, 7.0], [0.0, 3.0, 4.0]]
    frequency, amplitude = binned([*rows, row_of([9.0], 2.0)], 100, 8.0)
    assert frequency.tolist() == [0.0, 4.0]
    np.testing.assert_array_equal(amplitude, [[1.0, 5.0], [0.0, 3.0], [9.0, math.nan]])
    with pytest.raises(ValueError, match="at least one spectrum"):
        binned([], 3)
