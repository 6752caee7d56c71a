"""The quota of store and files: kept at every hour, also when it is lowered; what gives way first, and what never."""

from __future__ import annotations

import json
import random
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from monitor.config.load import ConfigError, load_config
from monitor.records import compact, rollup
from monitor.records.database import SharedConnection
from monitor.records.quota import KINDS, given_up, least_bytes
from monitor.records.rollup import LEVELS_S, SeriesKey, drop_buckets, roll_up
from monitor.records.spectra import read_block_view, strip_views, viewed_blocks
from monitor.records.store import Store
from monitor.records.trends import read_trends
from monitor.service.daemon import Daemon
from monitor.service.start import inspect, store_refusals
from monitor.web.answers import RequestError
from monitor.web.channel_view import cyclic, waveform
from tests.monitor.records.condensed import BEGIN as FILLED_FROM
from tests.monitor.records.condensed import DAY, fill
from tests.support.daemon import last, put, running
from tests.support.daemons import make_machine, status
from tests.support.effort import effort_count
from tests.support.forks import Fork
from tests.support.quota import Bounded
from tests.support.victims import give_up_without_end
from tests.support.waiting import wait_until

QUOTA = 5_000_000.0
KILLS = effort_count(quick=4, full=100)


@pytest.fixture(autouse=True)
def _small_reserve() -> Iterator[None]:
    with patch.object(compact, "RESERVE_BYTES", 0), patch.object(rollup, "BATCH_BLOCKS", 4):
        yield


ACTION = st.tuples(
    st.sampled_from(["kept"] * 9 + ["newest"] * 6 + ["pinned"]),
    st.booleans(),
    st.booleans(),
    st.sampled_from([1.0, 1.0, 3.0, 11.0, 40.0]),
    st.sampled_from([None] * 20 + [0.8, 1.5]),
)


@given(actions=st.lists(ACTION, min_size=30, max_size=90), quota=st.sampled_from([QUOTA, 2.0 * QUOTA]))
@settings(
    max_examples=effort_count(quick=4, full=200),
    deadline=None,
    phases=set(Phase) - {Phase.shrink},
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.function_scoped_fixture],
)
def test_any_sequence_of_blocks_keeps_to_the_quota_and_loses_nothing_that_stays(
    tmp_path_factory: pytest.TempPathFactory, actions: list[Any], quota: float
) -> None:
    bounded = Bounded(tmp_path_factory.mktemp("any") / "state.db", quota)
    pinned: set[int] = set()
    events: set[int] = set()
    forecasts: set[int] = set()
    for kind, event, forecast, hours, factor in actions:
        bounded.block(kind if len(pinned) < 8 else "kept", event=event, forecast=forecast)
        pinned |= {bounded.number} if kind == "pinned" and len(pinned) < 8 else set()
        events |= {bounded.number} if event else set()
        forecasts |= {bounded.number} if forecast else set()
        if factor is not None:
            bounded.limit(max(QUOTA, factor * bounded.quota))
        assert bounded.hour(hours) <= bounded.quota, bounded.retention.problem
    assert bounded.retention.problem is None
    bounded.check(pinned, events, forecasts)
    bounded.close()


def test_what_gives_way_first_is_what_is_needed_least(tmp_path: Path) -> None:
    bounded = Bounded(tmp_path / "state.db", QUOTA)
    seen: list[str] = []
    quota = QUOTA
    for number in range(150):
        bounded.block("pinned" if number in (20, 21) else "kept", event=number == 20, forecast=number > 100)
        if number > 60 and len(seen) < len(KINDS) - 1:
            quota *= 0.97
            bounded.limit(quota)
        bounded.hour(1.0)
        seen += [kind for kind in given_up(bounded.store) if kind not in seen]
        if "waveforms" in seen and "raw_spectra" not in seen:
            assert len(viewed_blocks(bounded.store, "x")) == bounded.number
        if seen and "records" not in seen:
            assert bounded.store.rows("SELECT count(*) FROM identities") == [(0,)]
    assert seen == list(KINDS[:-1])
    assert bounded.deleted
    gone = given_up(bounded.store)
    assert gone["waveforms"].since < gone["records"].since < bounded.time
    bounded.check({21, 22}, {21}, set(range(102, 151)))
    values = bounded.retention.values()
    assert values is not None
    assert values["used_gb"] <= values["max_gb"] == quota / 1e9
    assert list(values["given_up"]) == seen
    bounded.close()


def test_a_quota_below_what_must_stay_is_a_problem_and_nothing_more_leaves(tmp_path: Path) -> None:
    bounded = Bounded(tmp_path / "state.db", 100_000.0)
    for number in range(30):
        bounded.block("pinned" if number < 5 else "kept")
        bounded.hour(3.0)
    assert "needed for states" in (bounded.retention.problem or "")
    bounded.check(set(range(1, 6)), set(), set())
    bounded.limit(QUOTA)
    bounded.hour()
    assert bounded.retention.problem is None
    bounded.close()


def test_a_stripped_view_has_its_spectra_then_nothing(tmp_path: Path) -> None:
    bounded = Bounded(tmp_path / "state.db", QUOTA)
    for kind in ("kept", "kept", "pinned", "kept", "newest"):
        bounded.block(kind)
        bounded.time += 60.0
    before = read_block_view(bounded.store, "x", at=1)
    with bounded.store.transaction() as connection:
        assert strip_views(connection, whole=False) == 2
        assert strip_views(connection, whole=False) == 0
    row = read_block_view(bounded.store, "x", at=1)
    assert before is not None and before.view is not None and row is not None and row.view is not None  # noqa: PT018
    assert row.view.waveform.size == 0
    page: Any = SimpleNamespace(store=bounded.store, channel=lambda _: SimpleNamespace(source="s", unit="g"))
    for answer in (waveform, cyclic):
        with pytest.raises(RequestError) as refused:
            answer(page, "x", {"block": "1"})
        assert refused.value.status == 404
    assert (row.view.spectra.amplitude == before.view.spectra.amplitude).all()
    assert (row.view.spectra.highest == before.view.spectra.highest).all()
    with bounded.store.transaction() as connection:
        assert strip_views(connection, whole=True) == 2
    assert viewed_blocks(bounded.store, "x") == [3, 4, 5]
    bounded.check({3, 4}, set(), set())
    bounded.close()


def test_trends_without_their_fine_buckets_are_shown_by_wider_ones(tmp_path: Path) -> None:
    with Store.open(tmp_path / "state.db", machine="m") as store:
        count = fill(store)
        key = SeriesKey("s", "x", True)
        until = FILLED_FROM + 2.5 * DAY
        with store.transaction() as connection:
            while any(drop_buckets(connection, level, until, dated=True) for level in LEVELS_S[:2]):
                pass
            roll_up(connection, 60.0)
        with patch("monitor.records.trends._has_at_most", lambda *_: False), SharedConnection(store.path) as reader:
            whole = read_trends(reader, key, points=4000)
            young = read_trends(reader, key, since=until + 7200.0, points=4000)
        assert whole.resolution == 7200.0
        assert int(whole.records.sum()) == count
        assert young.resolution == 60.0
        assert (whole.low["rms"].min(), whole.high["rms"].max()) == (1.0, 7.0)


@pytest.mark.process
def test_a_quota_too_small_is_refused_with_the_number_that_will_do(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    text = config.read_text()
    config.write_text(f"{text}[retention]\nmax_gb = 0.001\n")
    refused = load_config(config)
    found = list(store_refusals(refused, inspect(refused)))
    assert len(found) == 1
    assert "retention.max_gb = 0.001" in found[0]
    with pytest.raises(ConfigError, match="expected at least"):
        Daemon(refused).run(None)  # type: ignore[arg-type]
    needed = float(found[0].rsplit(" ", 1)[1])
    assert needed * 1e9 >= least_bytes(None, 1, DAY)
    config.write_text(f"{text}[retention]\nmax_gb = {needed}\n")
    put(config, 0)
    with running(config):
        wait_until(lambda: last(config) == 2)
        wait_until(lambda: (status(config).get("retention") or {}).get("used_gb") is not None)
    kept = status(config)["retention"]
    assert 0.0 < kept["used_gb"] < kept["max_gb"] == needed
    assert kept["given_up"] == {}


@pytest.mark.process
def test_a_process_killed_while_it_gives_up_loses_nothing_that_stays(tmp_path: Path) -> None:
    generator = random.Random(20261128)
    path = tmp_path / "state.db"
    acknowledged = 0
    for _ in range(KILLS):
        child = Fork(give_up_without_end, path)
        messages = [child.receive() for _ in range(30)]
        time.sleep(generator.uniform(0.0, 0.3))
        messages += child.kill()
        acknowledged = max([acknowledged, *messages])
        with Store.open(path, machine="m") as store:
            assert store.check() == []
            assert store.last("s") >= acknowledged
            for header, view in store.rows("SELECT header, view FROM spectra"):
                sizes = json.loads(header).get("view", {}).get("sizes")
                assert (view is None) == (sizes is None)
                assert view is None or sum(sizes) == len(view)
    bounded = Bounded(path, QUOTA)
    numbers = range(1, bounded.number + 1)
    bounded.time += 3600.0 * bounded.number
    bounded.check({n for n in numbers if n <= 10}, {n for n in numbers if n % 10 == 0}, set(numbers))
    assert "waveforms" in given_up(bounded.store)
    assert "records" in given_up(bounded.store)
    bounded.close()
