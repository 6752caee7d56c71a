from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.record import Record
from monitor.health.schema import EDV_STATUSES, TT_STATUSES
from monitor.records.publish import day_dataset, publish
from monitor.records.store import Store
from monitor.report.figures.spectrum import SpectrumView
from monitor.report.options import Options
from monitor.report.readings import named_fault
from monitor.report.report import build_report
from monitor.report.runs import ReportError, read_runs
from monitor.report.statements import advice_of
from monitor.report.verdict import judge
from monitor.words.advice import ADVICE
from monitor.words.statuses import EDV_REFUSALS, TT_REFUSALS
from tests.oracles.lives import life
from tests.oracles.page import Page
from tests.oracles.records_oracle import records
from tests.support.effort import effort_count
from tests.support.report import one, page_of, page_of_records

pytestmark = pytest.mark.usefixtures("plain_layout")
START = 1_700_000_000.0


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    path = tmp_path_factory.mktemp("life") / "state.db"
    with Store.open(path, machine="press 4") as store:
        store.describe({"config_hash": "c1", "calibrated": "no"})
        store.commit_many([(record, {}) for record in life(start=START)])
        yield store


@pytest.fixture(scope="module")
def told(stored: Store, tmp_path_factory: pytest.TempPathFactory) -> tuple[Page, Path]:
    """The report of the life with a spectrum, and its file."""
    frequency = np.arange(0.0, 700.0, 0.2)
    lines = {"outer": 97.8, "inner": 142.2, "ball": 94.0, "cage": 8.2}
    spectrum = SpectrumView(frequency, np.abs(np.sin(frequency)), lines, "block 550")
    folder = tmp_path_factory.mktemp("told")
    page = page_of(folder, stored, spectra={"horizontal": spectrum}, pending=3, title="Press 4")
    return page, folder / "report.html"


def test_a_life_is_told_in_words_and_numbers(told: tuple[Page, Path]) -> None:
    page, _ = told
    for sentence in (
        "Press 4",
        "In the final stage of its life: damage of the outer race",
        "The final stage began at block 400, 2023-11-15 06:52:20 UTC.",
        "This was known at block 405, 2023-11-15 06:57:20 UTC.",
        "Outer race. At best lines 12.0 times the noise floor, modulation depth 0.40 (block 600).",
        "The threshold of 0.05 mm³/mm was reached. By block 552.",
        "On the scale of a model that is not calibrated.",
        "The model of the rig was not calibrated on this machine",
        "come from a simulated rig",
        "No sign of damage",
        "Level unknown (the sensor's unit is not configured)",
        "Envelope spectrum, block 550",
        "603 blocks offered = 594 accepted + 6 rejected + 3 pending.",
        "97: b97.csv: sample 5 is <NaN>",
        "the final stage of its life has begun, with block 400",
        "c1",
    ):
        assert sentence in page.text, sentence


def test_the_page_needs_nothing_but_itself(told: tuple[Page, Path]) -> None:
    page, path = told
    assert path.stat().st_size < 1_500_000
    assert set(page.tags).isdisjoint({"link", "img", "iframe", "object"})
    assert page.addresses
    assert all(address.startswith(("#", "data:image/png;base64,")) for address in page.addresses)
    assert len(page.ids) == len(set(page.ids))
    assert {address[1:] for address in page.addresses if address.startswith("#")} <= set(page.ids)
    text = path.read_text(encoding="utf-8")
    assert "@import" not in text
    assert not re.search(r"url\((?!#)", text)
    assert str(path.parent) not in text


@pytest.fixture
def short(tmp_path: Path) -> Iterator[Store]:
    """A life of two days in few blocks."""
    with Store.open(tmp_path / "short.db", machine="press 4") as store:
        store.commit_many([(record, {}) for record in life(150, start=START, onset=100, learn=40)])
        yield store


def test_the_same_page_from_store_files_folder_and_dataset(short: Store, tmp_path: Path) -> None:
    paths = publish(short, tmp_path / "out" / "records")
    assert len(paths) == 2
    with xr.open_dataset(paths[1]) as decoded:
        days = [day_dataset(short, int(START // 86400)), decoded.load()]
    sources = (short, days, short.path, paths, paths[0].parent, tmp_path / "out")
    # Quick effort compares whole pages of a store and of data sets, and of all sources those without pictures.
    whole = sources[: effort_count(quick=2, full=len(sources))]
    bare = Options(title="t", sections=frozenset({"events", "provenance"}))
    for compared, options in ((whole, Options(title="t")), (sources, bare)):
        texts = [page_of(tmp_path, source, options=options).text for source in compared]
        assert len({re.sub(r"Written .*? UTC", "", text) for text in texts}) == 1


def test_names_from_outside_are_only_text(tmp_path: Path) -> None:
    evil = '<script>alert("1")</script>'
    record = one({"rms": 1.0, "stage": "learning"})
    bad = Record("s", 2, f"/home/someone/{evil}.csv", "h", "unreadable", (), "/srv/data/in/b.csv: not text", None, 1.0)
    channel = Record("s", 3, "c", "h", elapsed=2.0, channels={evil: {"rms": 1.0, "stage": "healthy"}})
    page = page_of_records(tmp_path, [record, bad, channel], title=evil, notes=(evil, "see /etc/x/config.toml"))
    assert "script" not in page.tags
    assert page.text.count(evil) >= 3
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "/home" not in text
    assert "/srv" not in text
    assert "/etc" not in text
    assert "b.csv: not text" in page.text


@pytest.mark.parametrize("status", [status for status in EDV_STATUSES if status not in ("ok", "widened")])
def test_every_refusal_of_a_volume_is_spelt_out(tmp_path: Path, status: str) -> None:
    page = page_of_records(tmp_path, [one({"rms": 1.0, "stage": "final", "edv_status": status})])
    refusal = EDV_REFUSALS[status]
    assert f"No value. {refusal[0].upper()}{refusal[1:]}." in page.text


@pytest.mark.parametrize("status", [status for status in TT_STATUSES if status not in ("ok", "already_crossed")])
def test_every_refusal_of_a_forecast_is_spelt_out(tmp_path: Path, status: str) -> None:
    page = page_of_records(tmp_path, [one({"rms": 1.0, "stage": "final", "tt_status": status, "v_th": 5e-8})])
    assert f"No forecast. For the threshold of 0.05 mm³/mm: {TT_REFUSALS[status]}." in page.text


def test_a_volume_that_is_gone_is_not_shown_as_if_it_stood(tmp_path: Path) -> None:
    first = one({"rms": 1.0, "stage": "final", "edv_status": "ok", "v_eq": 2e-8})
    second = one({"rms": 1.0, "stage": "final", "edv_status": "above_map"}, sequence=2, elapsed=5.0)
    page = page_of_records(tmp_path, [first, second])
    assert f"Last 0.02 mm³/mm. At block 1; since then none: {EDV_REFUSALS['above_map']}." in page.text


def test_intervals_probabilities_and_several_thresholds_are_said(tmp_path: Path) -> None:
    values = {"stage": "final", "edv_status": "ok", "v_eq": 2e-8, "v_eq_lower": 1e-8, "v_eq_upper": 3e-8}
    values |= {"v_th": (3e-8, 5e-8), "tt": (600.0, None), "tt_lower": (300.0, None), "tt_upper": (7200.0, None)}
    values |= {"p_threshold": (0.9, None), "tt_status": ("ok", "concave")}
    page = page_of_records(tmp_path, [one(values)])
    assert "0.02 mm³/mm. Interval: 0.01 mm³/mm to 0.03 mm³/mm." in page.text
    assert (
        "10 min to the threshold of 0.03 mm³/mm. Interval: 5 min to 2 h. Reached within the maintenance window with a "
        "probability of 90%." in page.text
    )
    assert f"No forecast. For the threshold of 0.05 mm³/mm: {TT_REFUSALS['concave']}." in page.text


def test_a_crossing_that_is_only_likely_is_said_to_be_so(tmp_path: Path) -> None:
    values = {"stage": "final", "edv_status": "ok", "v_eq": 6e-8, "v_eq_lower": 4e-8, "v_eq_upper": 8e-8}
    values |= {
        "v_th": (5e-8,),
        "tt": (0.0,),
        "tt_lower": (0.0,),
        "tt_upper": (5400.0,),
        "tt_status": ("already_crossed",),
    }
    with Store.open(tmp_path / "state.db", machine="m") as store:
        store.describe({"interval_level": 0.8, "prior": "x: 9 lives"})
        store.commit_many([(one(values), {})])
        page = page_of(tmp_path, store)
    assert (
        "The threshold of 0.05 mm³/mm has more likely than not been reached. 80 % interval: up to 1 h 30 min from now."
        in page.text
    )
    assert "What is given as 80 % interval leans on the bearing being one of these: x: 9 lives." in page.text


@pytest.mark.parametrize(
    ("values", "severity", "headline"),
    [
        ({"stage": "learning"}, "open", "Still learning"),
        (
            {"stage": "learning", "fault": "inner|ball"},
            "open",
            "No baseline yet; a pattern of the inner race or rolling element (hint)",
        ),
        ({"stage": "healthy"}, "good", "No sign of damage"),
        ({"stage": "healthy", "fault": "cage"}, "open", "No onset so far; a pattern of the cage (hint)"),
        ({"stage": "final"}, "watch", "In the final stage of its life, but no part named"),
        ({"stage": "end_of_life", "t_eol": 0.0, "t_eol_block": 1}, "bad", "End of life reached"),
        ({}, "open", "No verdict"),
    ],
)
def test_headlines(tmp_path: Path, values: dict[str, Any], severity: str, headline: str) -> None:
    page = page_of_records(tmp_path, [one({"rms": 1.0, **values})])
    assert headline in page.text
    assert f'class="card {severity}"' in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_what_to_do_is_said_in_the_words_of_the_configuration(tmp_path: Path) -> None:
    values = {"rms": 1.0, "stage": "final", "fault": "outer", "fault_basis": "verdict", "t_fs_known_block": 1}
    page = page_of_records(tmp_path / "default", [one(values)])
    assert "What to do? Inspect the bearing and plan its exchange at the next planned stop." in page.text
    assert "Final stage of its life: outer race." in page.text
    (tmp_path / "own").mkdir()
    with Store.open(tmp_path / "own" / "state.db", machine="m") as store:
        store.describe({"bearing": "x: drive", "advice": json.dumps({"warning": "call 4711 about {bearing}"})})
        store.commit_many([(one(values), {})])
        page = page_of(tmp_path / "own", store)
        (run,) = read_runs(store)
    assert "What to do? Call 4711 about bearing drive." in page.text
    for broken in ('{"warning": "{machine}"}', "[1]", '{"warning": "a"}; {"warning": "b"}'):
        assert advice_of(replace(run, attributes={"advice": broken})) == ADVICE
    healthy = page_of_records(tmp_path / "healthy", [one({"rms": 1.0, "stage": "healthy"})])
    assert "What to do? Nothing to do. Healthy so far." in healthy.text


def test_in_the_final_stage_the_strongest_name_since_it_was_known_stands(tmp_path: Path) -> None:
    rows = [
        ("healthy", "cage", 90.0),
        ("final", "inner", 20.0),
        ("final", "outer", 30.0),
        ("final", "inner", 25.0),
        ("final", None, 5.0),
    ]
    made = [
        one({"rms": 1.0, "stage": stage, "fault": fault, "fault_score": score}, sequence=number, elapsed=float(number))
        for number, (stage, fault, score) in enumerate(rows, start=1)
    ]
    with Store.open(tmp_path / "state.db", machine="m") as store:
        store.commit_many([(record, {}) for record in made])
        (run,) = read_runs(store)
    assert named_fault(run.channels["x"]) == (2, "outer")
    assert "outer race" in judge(run, run.channels["x"]).headline


def test_records_without_any_accepted_block(tmp_path: Path) -> None:
    made = [Record("s", number, f"{number}", "", "unreadable", (), "no text") for number in (1, 2)]
    page = page_of_records(tmp_path, made)
    assert "2 blocks offered = 0 accepted + 2 rejected + 0 pending." in page.text
    assert "No channel has a value." in page.text


def test_a_rejected_first_block_of_a_dated_machine_makes_no_second_run(tmp_path: Path) -> None:
    first = Record("s", 1, "1", "", "unreadable", (), "no text")
    second = one({"rms": 1.0, "stage": "healthy"}, sequence=2, time=START)
    with Store.open(tmp_path / "state.db", machine="m") as store:
        store.commit_many([(first, {}), (second, {})])
        (run,) = read_runs(store)
        published = read_runs(publish(store, tmp_path / "records"))
    assert run.dated
    assert run.counts == published[0].counts == {"ok": 1, "unreadable": 1}


def test_several_machines_and_sources_keep_apart(tmp_path: Path) -> None:
    made = [
        one({"rms": 1.0, "stage": "healthy"}),
        one({"rms": 1.0}, source="t", channels={"y": {"rms": 2.0, "stage": "learning"}}),
        Record("t", 2, "bad", "", "nan", elapsed=5.0),
    ]
    with Store.open(tmp_path / "a.db", machine="a") as store:
        store.commit_many([(record, {}) for record in made])
        runs = read_runs([store])
    assert runs[0].channels["x"].status.tolist() == ["ok"]
    assert runs[0].channels["y"].status.tolist() == ["ok", "nan"]
    with Store.open(tmp_path / "b.db", machine="b") as store:
        store.commit(made[0], {})
    page = page_of(tmp_path, [tmp_path / "a.db", tmp_path / "b.db"])
    assert "Machine a : 3 blocks" in page.text
    assert "Machine b : 1 block" in page.text


@given(
    st.lists(
        records(bands=2, numbers=st.floats(-1e6, 1e6)), min_size=1, max_size=6, unique_by=lambda record: record.sequence
    ),
    st.integers(0, 40),
)
@settings(max_examples=effort_count(quick=6, full=300))
def test_any_records_make_a_whole_page(
    tmp_path_factory: pytest.TempPathFactory, made: list[Record], points: int
) -> None:
    frequency = np.linspace(0.0, 100.0, points)
    spectrum = SpectrumView(frequency, np.zeros(points), {"outer": 10.0})
    page_of_records(tmp_path_factory.mktemp("any"), made, spectra={"x": spectrum})


def test_a_recording_without_times_is_drawn_over_its_blocks(tmp_path: Path) -> None:
    made = [one({"rms": float(number), "stage": "learning"}, sequence=number, elapsed=None) for number in range(1, 9)]
    page = page_of_records(tmp_path, made)
    assert "from the first block" not in page.text
    assert page.tags.count("svg") == 1


def test_what_cannot_be_reported_is_said(tmp_path: Path) -> None:
    text = tmp_path / "text.nc"
    text.write_text("no netCDF")
    other = tmp_path / "other.nc"
    xr.Dataset({"a": ("x", [1.0])}).to_netcdf(other)
    newer = tmp_path / "newer.nc"
    xr.Dataset(coords={"time": [0.0]}, attrs={"schema_version": 99}).to_netcdf(newer)
    empty = tmp_path / "empty"
    empty.mkdir()
    for found, message in (
        (text, r"text\.nc: cannot be read as netCDF"),
        (other, r"other\.nc: is netCDF, but holds no health records"),
        (newer, "schema version 99"),
        (empty, "neither .nc files"),
        (tmp_path / "none.nc", "no such file"),
        ([], "no records"),
    ):
        with pytest.raises(ReportError, match=message):
            build_report(found, tmp_path / "report.html")
    assert not (tmp_path / "report.html").exists()


def test_a_report_that_cannot_be_written_is_said(stored: Store, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ReportError, match="cannot be written"):
        build_report(stored, tmp_path / "file" / "report.html", options=Options(sections=frozenset({"events"})))


def test_long_lives_make_no_long_pages(tmp_path: Path) -> None:
    made = [
        one(
            {"rms": 1.0 + math.sin(number), "h_or": 1.0 + math.cos(number), "detect_score": 1.0, "stage": "healthy"},
            sequence=number,
            elapsed=10.0 * number,
        )
        for number in range(1, effort_count(quick=3001, full=6001))
    ]
    page_of_records(tmp_path, made)
    assert (tmp_path / "report.html").stat().st_size < 400_000


def test_an_empty_store_is_said_to_be_empty(tmp_path: Path) -> None:
    with Store.open(tmp_path / "state.db", machine="m") as store, pytest.raises(ReportError, match="no records"):
        build_report(store, tmp_path / "report.html")


def test_gaps_and_a_run_without_an_onset_are_told(tmp_path: Path) -> None:
    page = page_of_records(tmp_path, life(80, onset=200, learn=40))
    assert "No sign of it." in page.text
    assert "No final stage so far." in page.text
    assert "1 gap, 2 h 1 min in all." in page.text
    assert "The longest gap lasts 2 h 1 min." in page.text


def test_a_volume_above_the_threshold_and_a_time_until_then_are_said_to_disagree(tmp_path: Path) -> None:
    values = {"stage": "final", "edv_status": "ok", "v_eq": 6e-8, "v_th": 5e-8, "tt": 300.0, "tt_status": "ok"}
    page = page_of_records(tmp_path, [one(values)])
    assert "5 min to the threshold of 0.05 mm³/mm." in page.text
    assert "V_eq as tracked stands above it already" in page.text
