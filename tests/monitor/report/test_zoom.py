from __future__ import annotations

import base64
import hashlib
import html
import itertools
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.record import Record
from monitor.records.store import Store
from monitor.report.figures.drawing import BLUE, GREEN, new_figure, time_axis
from monitor.report.figures.zoom import Band, Line, Panel, zoom_data, zoom_json
from monitor.report.options import Options
from monitor.report.report import build_report
from monitor.words.numbers import Clock
from tests.oracles.lives import life
from tests.support.effort import effort_count

START = 1_700_000_000.0


def charts_of(text: str) -> list[dict[str, Any]]:
    return [json.loads(found) for found in re.findall(r'<script type="application/json">(.*?)</script>', text)]


def moments(data: dict[str, Any]) -> np.ndarray:
    return np.round(data["start"] + np.cumsum([0.0, *data["steps"]]), 3)


def numbers_of(data: dict[str, Any], column: int) -> np.ndarray:
    return np.array([np.nan if value is None else value for value in data["columns"][column]])


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("life") / "state.db"
    with Store.open(path, machine="press 4") as store:
        store.describe({"config_hash": "c1"})
        store.commit_many([(record, {}) for record in life(start=START)])
    return path


@pytest.fixture(scope="module")
def page(stored: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The report of the life, which several tests read."""
    return build_report(stored, tmp_path_factory.mktemp("page") / "a.html").read_text(encoding="utf-8")


def drawn(time: np.ndarray, lines: list[np.ndarray], bins: int) -> dict[str, Any]:
    _, (axes,) = new_figure(3.0)
    axes.set_ylabel("RMS (g)")
    panel = Panel(axes, [Line(f"line {place}", BLUE, values) for place, values in enumerate(lines)])
    return zoom_data(time_axis(time, Clock(True)), time, [panel], bins=bins)


@settings(max_examples=effort_count(quick=12, full=400))
@given(st.integers(2, 400), st.integers(1, 3), st.integers(2, 20), st.integers(0, 2**32 - 1))
def test_every_kept_value_is_a_block_and_no_extreme_is_lost(size: int, lines: int, bins: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = START + np.cumsum(rng.choice([10.0, 10.0, 10.0, 500.0], size))
    made = [np.where(rng.random(size) < 0.1, np.nan, rng.lognormal(0, 2, size)) for _ in range(lines)]
    data = drawn(time, made, bins)
    at = moments(data)
    for place, line in enumerate(data["panels"][0]["lines"]):
        values = numbers_of(data, line["column"])
        assert values.size == at.size
        own = made[int(line["label"].removeprefix("line "))]
        places = {float(moment): value for moment, value in zip(time, own, strict=True)}
        for moment, value in zip(at, values, strict=True):
            if np.isfinite(value):
                assert value == pytest.approx(places[float(moment)], rel=1e-3), place
        assert np.nanmax(values) == pytest.approx(np.nanmax(own), rel=1e-3)
        assert np.nanmin(values) == pytest.approx(np.nanmin(own), rel=1e-3)
    assert at.size <= max(3 * lines * bins + 2, 2 * size)


def test_lines_break_where_blocks_are_missing() -> None:
    time = START + np.array([0.0, 10.0, 20.0, 30.0, 300.0, 310.0, 320.0, 330.0])
    data = drawn(time, [np.arange(1.0, 9.0)], 600)
    values = numbers_of(data, 0)
    assert np.isnan(values).tolist() == [False] * 4 + [True] + [False] * 4
    assert time[3] < moments(data)[4] < time[4]


def test_what_is_the_same_line_stands_once() -> None:
    time = START + np.arange(50.0)
    values = np.sqrt(time - START)
    _, (axes,) = new_figure(3.0)
    panel = Panel(axes, [Line("a", BLUE, values), Line("b", GREEN, values.copy())], [Band("c", BLUE, values, values)])
    data = zoom_data(time_axis(time, Clock(True)), time, [panel])
    assert [line["label"] for line in data["panels"][0]["lines"]] == ["a"]
    assert len(data["columns"]) == 1


def test_the_charts_hold_what_the_pictures_show(page: str) -> None:
    text, charts = page, charts_of(page)
    names = re.findall(r'<figure data-name="(\w+)"(?:(?!</figure>).)*?<script', text, re.DOTALL)
    assert len(charts) == len(names)
    assert {"trends", "damage", "forecast"} <= set(names)
    trends = charts[names.index("trends")]
    figures = re.findall(r'<figure data-name="trends" data-values="([^"]*)"', text)
    shown = json.loads(html.unescape(figures[0]))
    at, rms = moments(trends), numbers_of(trends, trends["panels"][0]["lines"][0]["column"])
    values = shown["rms_g"]["value"] if isinstance(shown["rms_g"], dict) else shown["rms_g"]
    known = np.array([value for value in values if value is not None])
    assert np.nanmax(rms) == pytest.approx(known.max(), rel=1e-3)
    assert np.nanmin(rms) == pytest.approx(known.min(), rel=1e-3)
    assert at[0] >= START
    marks = {mark["label"]: mark["at"] for mark in trends["marks"]}
    assert marks["final stage began"] == pytest.approx(shown["t_fs_s"])
    assert {tick["label"] for tick in trends["ticks"]} >= {"rejected"}
    assert trends["panels"][0]["label"] == "RMS (g)"
    assert trends["panels"][0]["levels"][0]["value"] == pytest.approx(shown["rms_learned_g"], rel=1e-3)


def test_only_the_script_of_the_page_may_run(page: str) -> None:
    text, scripts = page, re.findall(r"<script([^>]*)>(.*?)</script>", page, re.DOTALL)
    running = [body for attributes, body in scripts if "application/json" not in attributes]
    assert len(running) == 1
    assert all("src" not in attributes for attributes, _ in scripts)
    assert "Copyright (c)" in running[0][:600]
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)
    assert policy is not None
    digest = base64.b64encode(hashlib.sha256(running[0].encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy[1]
    assert "default-src 'none'" in policy[1]
    assert policy[1].count("sha256-") == 1
    assert not re.search(r"<[^>]+\son\w+=", re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL))


def test_a_page_without_such_figures_runs_nothing(stored: Path, tmp_path: Path) -> None:
    options = Options(sections=frozenset({"quality", "events"}))
    text = build_report(stored, tmp_path / "a.html", options=options).read_text(encoding="utf-8")
    assert "<script" not in text
    assert "script-src" not in text


def test_no_name_ends_the_data_of_a_figure(tmp_path: Path) -> None:
    evil = "</script><img src=x onerror=alert(1)><!--"
    assert json.loads(zoom_json({"a": evil})) == {"a": evil}
    assert not set("<>&") & set(zoom_json({"a": evil + "&"}))
    made = [
        Record("s", number, "a", f"{number:x}", elapsed=float(number), channels={evil: {"rms": 1.0 + number}})
        for number in range(1, 9)
    ]
    with Store.open(tmp_path / "state.db", machine="m") as store:
        store.commit_many([(record, {}) for record in made])
    text = build_report(tmp_path, tmp_path / "a.html").read_text(encoding="utf-8")
    assert "<img" not in text
    assert len(charts_of(text)) == 1


def test_a_long_life_stays_small() -> None:
    rng = np.random.default_rng(1)
    time = START + 10.0 * np.arange(30_000)
    lines = [rng.lognormal(0, 1, time.size) for _ in range(4)]
    text = zoom_json(drawn(time, lines, 600))
    assert len(text) < 250_000
    assert list(itertools.islice(json.loads(text)["steps"], 1))
