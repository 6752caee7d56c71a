from __future__ import annotations

import csv
import json
import math
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from models.maps.build import build_map
from models.maps.file import save_map
from models.maps.plan import MapPlan
from models.work.choose import local_runner
from models.work.folder_store import FolderStore
from models.work.pool import SerialExecutor
from models.work.runner import Runner
from models.work.task import Failure, Work
from monitor.commands import report_batch
from monitor.commands.report import command
from monitor.commands.report_batch import (
    BatchRun,
    BatchSettings,
    Pages,
    ReportTask,
    find_runs,
    report_one,
    reused,
    run_batch,
)
from monitor.commands.shared_folders import Seen, SharedFolderError, raise_if_unseen
from monitor.health.record import Record, plain
from monitor.records.store import Store
from monitor.report.options import SECTIONS, Options, read_options
from monitor.report.report import build_report
from monitor.report.runs import ReportError, read_runs
from monitor.report.summary import RunSummary
from monitor.report.tables import Column, Table, write_tables
from tests.monitor.report.dying import dies
from tests.oracles.lives import GRAVITY, life
from tests.oracles.page import Page
from tests.support.effort import effort_count
from tests.support.forks import fork_workers

pytestmark = pytest.mark.usefixtures("plain_layout")
START = 1_700_000_000.0
# Pages of one section without a figure, where what they hold is another matter.
SHORT_PAGES = BatchSettings(Options(sections=frozenset({"events"})), tables=False)


def store_at(folder: Path, made: list[Record], machine: str = "press") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    with Store.open(folder / "state.db", machine=machine) as store:
        store.commit_many([(record, {}) for record in made])
    return folder


def with_sizes(made: list[Record], load: float) -> list[Record]:
    """Give records of the final stage the sizes that a tracker would, and a load."""
    changed = []
    for record in made:
        values = dict(record.channels.get("horizontal", {}))
        if values.get("v_eq"):
            values |= {"dphi_d": math.radians(5.0), "h_d": 1e-6 * (2.0 + record.sequence / 200.0), "speed": 40.0}
        values |= {"load": load} if values else {}
        channels = {"horizontal": plain(values)} if values else {}
        changed.append(Record(**{**record.__dict__, "channels": channels}))
    return changed


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three good runs, one healthy, and one whose store is no database."""
    root = tmp_path_factory.mktemp("fleet")
    store_at(root / "hall A" / "one", life(150, start=START, onset=100, learn=40))
    store_at(root / "hall A" / "two", life(150, onset=120, learn=40, seed=2), "lathe")
    store_at(root / "hall B" / "one", life(60, start=START, onset=100, learn=40), "saw & co")
    (root / "broken").mkdir()
    (root / "broken" / "state.db").write_bytes(b"no database at all")
    return root


def page_at(path: Path) -> Page:
    return Page(path.read_text(encoding="utf-8"))


def invoke(*arguments: object) -> tuple[int, dict[str, Any]]:
    outcome = CliRunner().invoke(command, [str(argument) for argument in (*arguments, "--json", "--quiet")])
    if outcome.exception is not None and not isinstance(outcome.exception, SystemExit):
        raise outcome.exception
    return outcome.exit_code, json.loads(outcome.stdout)


def test_a_batch_reports_what_it_can_and_lists_the_rest(fleet: Path, tmp_path: Path) -> None:
    include = tmp_path / "include.toml"
    include.write_text('[report]\ninclude = ["final_stage", "events", "comparison"]\n')
    code, told = invoke("--batch", fleet, "--out", tmp_path, "--workers", 1, "--include", include)
    assert code == 1
    assert told["failed"] == 1
    names = {run["name"]: run for run in told["runs"]}
    assert set(names) == {"broken", "hall_A-one", "hall_A-two", "hall_B-one"}
    assert "not a database" in names["broken"]["error"]
    assert names["hall_A-one"]["states"] == ["watch"]
    assert names["hall_B-one"]["states"] == ["good"]
    index = page_at(tmp_path / "index.html")
    assert "3 runs: ▲ 2 damage , ● 1 no sign of damage" in index.text
    assert "1 without a report" in index.text
    assert "saw & co, hall_B-one" in index.text
    linked = {address for address in index.addresses if address.endswith(".html")}
    assert linked == {f"{name}/report.html" for name in names if name != "broken"}
    for address in linked:
        assert page_at(tmp_path / address).open == []
    assert json.loads((tmp_path / "failures.json").read_text())[0]["run"] == "broken"
    with (tmp_path / "tables" / "final_stages.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["t_fs_s"]) for row in rows] == [START + 60.0 * 99 + 7200.0, 60.0 * 119 + 7200.0]


def test_a_second_batch_makes_only_what_changed(fleet: Path, tmp_path: Path) -> None:
    first = run_batch(find_runs(fleet, recordings=False), tmp_path, SHORT_PAGES)
    before = (tmp_path / "hall_A-one" / "report.html").stat().st_mtime_ns
    again = run_batch(find_runs(fleet, recordings=False), tmp_path, SHORT_PAGES)
    assert [outcome.reused for outcome in again] == [False, True, True, True]
    assert [outcome.summaries for outcome in again] == [outcome.summaries for outcome in first]
    assert (tmp_path / "hall_A-one" / "report.html").stat().st_mtime_ns == before
    (tmp_path / "hall_A-two" / "report.html").unlink()
    (tmp_path / "hall_B-one" / "run.json").write_text("{ cut off")
    third = run_batch(find_runs(fleet, recordings=False), tmp_path, SHORT_PAGES)
    assert [outcome.reused for outcome in third] == [False, True, False, False]
    smaller = Options(sections=frozenset({"provenance"}))
    fourth = run_batch(find_runs(fleet, recordings=False), tmp_path, BatchSettings(smaller))
    assert not any(outcome.reused for outcome in fourth)


@pytest.mark.parametrize("loose", [False, True])
def test_reading_a_store_for_the_first_time_is_no_change_of_it(tmp_path: Path, loose: bool) -> None:
    store_at(tmp_path / "in" / "a", life(60, onset=100, learn=40))
    if loose:
        (tmp_path / "in" / "a" / "state.db").rename(tmp_path / "in" / "a" / "old.db")
    (item,) = find_runs(tmp_path / "in", recordings=False)
    for expected in (False, True):
        (outcome,) = run_batch([item], tmp_path / "out", SHORT_PAGES)
        assert outcome.error == ""
        assert outcome.reused is expected
    mapped = replace(SHORT_PAGES.options, maps={"": cast("Any", SimpleNamespace(hash="of another map"))})
    assert reused(Pages.of(tmp_path / "out", replace(SHORT_PAGES, options=mapped)), item) is None
    with Store.open(tmp_path / "in" / "a" / ("old.db" if loose else "state.db"), machine="press") as store:
        store.commit(life(61, onset=100, learn=40)[60], {})
    assert not run_batch([item], tmp_path / "out", SHORT_PAGES)[0].reused


@pytest.mark.process
def test_a_process_that_dies_takes_no_other_run_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(report_batch, "REPORTS", Work("reports", dies, memory=1000))
    fork_workers(monkeypatch)
    items = [BatchRun(tmp_path, name) for name in ("b", "c")]
    with local_runner(2) as runner:
        outcomes = run_batch(items, tmp_path, BatchSettings(Options(), tables=False), runner)
    assert [outcome.error for outcome in outcomes] == ["the process that made its report died", ""]


def test_pages_made_through_a_store_are_those_of_a_plain_loop(fleet: Path, tmp_path: Path) -> None:
    runs = find_runs(fleet, recordings=False)
    plain_outcomes = run_batch(runs, tmp_path / "plain", SHORT_PAGES)
    with Runner(SerialExecutor(), FolderStore(tmp_path / "chunks")) as runner:
        outcomes = run_batch(runs, tmp_path / "shared", SHORT_PAGES, runner, elsewhere=True)
    assert outcomes == plain_outcomes
    for name in ("hall_A-one/report.html", "index.html"):
        pages = [
            re.sub(r"\d{4}-\d\d-\d\d \d\d:\d\d(:\d\d)?", "", (tmp_path / way / name).read_text())
            for way in ("shared", "plain")
        ]
        assert pages[0] == pages[1]
    assert not list((tmp_path / "shared").glob(".spallwatch-*"))


def test_a_worker_that_sees_other_folders_ends_the_batch(fleet: Path, tmp_path: Path) -> None:
    (run,) = find_runs(fleet / "hall B", recordings=False)
    pages = Pages.of(tmp_path, SHORT_PAGES)
    with pytest.raises(SharedFolderError, match=r"--out .* does not see this folder"):
        report_one(replace(pages, mark=".spallwatch-0123"), ReportTask(run))
    with pytest.raises(SharedFolderError, match=r"expected 1 files of 5 bytes .* sees 1 of"):
        report_one(pages, ReportTask(run, Seen(1, 5)))
    with pytest.raises(SharedFolderError, match="is not there on worker"):
        report_one(pages, ReportTask(replace(run, path=tmp_path / "none"), Seen(1, 5)))
    with Runner(SerialExecutor(), FolderStore(tmp_path / "chunks")) as runner:
        ((_, outcome),) = runner.outcomes(report_batch.REPORTS, pages, [ReportTask(run, Seen(1, 5))])
    assert isinstance(outcome, Failure)
    with pytest.raises(SharedFolderError, match="sees 1 of"):
        raise_if_unseen(outcome)


def test_recordings_are_replayed_where_a_configuration_is_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recordings = tmp_path / "in" / "take 1"
    recordings.mkdir(parents=True)
    rng = np.random.default_rng(1)
    for number in range(1, 4):
        rows = rng.normal(size=2560)
        lines = [f"9,39,{number},{i / 0.0256:.3f},{value:.3f},{value:.3f}\n" for i, value in enumerate(rows)]
        (recordings / f"acc_{number:05d}.csv").write_text("".join(lines))
    config = Path(__file__).parents[3] / "examples" / "pronostia_1800rpm_4000n.toml"
    run = BatchRun(recordings, "take_1", recording=True)
    pages = Pages.of(tmp_path / "out", BatchSettings(Options(), config_path=config, tables=False))
    outcome = report_one(pages, ReportTask(run))
    assert outcome.error == ""
    assert outcome.summaries[0].counts == {"ok": 3}
    again = reused(pages, run)
    assert again is not None
    assert again.summaries == outcome.summaries
    # A map or library of the configuration has changed since.
    assert reused(replace(pages, configured="other"), run) is None
    with pytest.raises(SharedFolderError, match=r"n\.toml: worker .* sees another configuration"):
        report_one(replace(pages, configured="other"), ReportTask(run))
    monkeypatch.setattr("monitor.commands.report_batch.program", lambda: "another")
    assert reused(pages, run) is None
    without = Pages.of(tmp_path / "out", BatchSettings(Options(), tables=False))
    assert "give --config FILE" in report_one(without, ReportTask(BatchRun(recordings, "other", recording=True))).error
    (item,) = find_runs(tmp_path / "in", recordings=True)
    assert item == BatchRun(recordings, "take_1", recording=True)


def test_what_is_no_batch_is_said(tmp_path: Path, fleet: Path) -> None:
    with pytest.raises(ReportError, match=r"holds no state\.db"):
        find_runs(tmp_path, recordings=False)
    with pytest.raises(ReportError, match="is no folder"):
        find_runs(tmp_path / "none", recordings=False)
    inside = fleet / "hall B"
    assert {item.name for item in find_runs(fleet, recordings=False, leave_out=inside)} == {
        *("broken", "hall_A-one", "hall_A-two")
    }


@pytest.fixture(scope="module")
def map_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("map") / "map.nc"
    extents, depths = tuple(math.radians(5.0 * i) for i in range(4)), tuple(3e-6 * i for i in range(5))
    save_map(build_map(MapPlan(load=(3000.0, 4000.0), speed=(40.0,), h_d=depths, dphi_d=extents)), path)
    return path


def test_the_first_prognostic_model_looks_defects_up_under_other_loads(tmp_path: Path, map_file: Path) -> None:
    from models.maps.file import load_map

    for name, load in (("a", 3000.0), ("b", 4000.0)):
        store_at(tmp_path / name, with_sizes(life(200, onset=100, learn=40), load), name)
    out, include = tmp_path / "report.html", tmp_path / "include.toml"
    include.write_text('[report]\ninclude = ["path", "comparison"]\n')
    options = ("--out", out, "--map", map_file, "--include", include, "--tables")
    code, told = invoke(tmp_path / "a", tmp_path / "b", *options)
    assert code == 0
    page = page_at(out)
    assert "The path over the RMS map" in page.text
    assert "The first prognostic model" in page.text
    assert str(out.with_name("report-tables") / "rms_at_end.csv") in told["tables"]
    with (out.with_name("report-tables") / "rms_at_end.csv").open() as file:
        rows = {row["run"]: row for row in csv.DictReader(file)}
    rms_map = load_map(map_file)
    size = math.radians(5.0), 1e-6 * (2.0 + 199 / 200.0)
    last = with_sizes(life(200, onset=100, learn=40), 0.0)[-1]
    size = last.channels["horizontal"]["dphi_d"], last.channels["horizontal"]["h_d"]
    expected = float(rms_map.slice_at(3000.0, 40.0).interpolate(*size)) / GRAVITY
    assert float(rows["a"]["defects_of_2_g"]) == pytest.approx(expected, rel=1e-4)
    assert rows["a"]["defects_of_1_g"] == ""
    assert float(rows["a"]["recorded_g"]) == pytest.approx(last.channels["horizontal"]["rms"] / GRAVITY, rel=1e-6)


def test_stores_of_the_same_machine_are_runs_of_their_own(tmp_path: Path) -> None:
    for name in ("first", "second"):
        store_at(tmp_path / name, life(60, onset=100, learn=40))
    runs = read_runs([tmp_path / "first", tmp_path / "second"])
    assert [run.label for run in runs] == ["press, first", "press, second"]
    assert [run.time.size for run in runs] == [60, 60]


def test_a_summary_comes_back_from_json_as_it_was(fleet: Path, tmp_path: Path) -> None:
    (outcome,) = run_batch(find_runs(fleet / "hall A" / "one", recordings=False), tmp_path, SHORT_PAGES)
    summary = outcome.summaries[0]
    stored = json.loads(json.dumps(summary.to_dict(), allow_nan=False))
    assert RunSummary.from_dict(stored) == summary
    with pytest.raises(ValueError, match="version 3 expected"):
        RunSummary.from_dict({**stored, "version": 1})


cell = st.none() | st.floats(allow_nan=False, allow_infinity=False)


@given(st.lists(st.tuples(st.text(st.characters(exclude_categories=("Cs", "Cc"))), cell), min_size=1, max_size=8))
@settings(max_examples=effort_count(quick=6, full=200))
def test_tables_hold_the_same_as_csv_and_netcdf(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[str, float | None]]
) -> None:
    folder = tmp_path_factory.mktemp("tables")
    columns = (Column("word", "word"), Column("volume", "volume", "m2", "mm2", 1e6))
    write_tables([Table("t", "T", columns, rows)], folder)
    with (folder / "t.csv").open(newline="", encoding="utf-8") as file:
        read = list(csv.DictReader(file))
    with xr.open_dataset(folder / "t.nc") as dataset:
        values = dataset.volume.values
        assert dataset.volume.attrs["units"] == "m2"
    for (word, value), line, stored in zip(rows, read, values, strict=True):
        assert line["word"] == (f"'{word}" if word[:1] in ("=", "+", "-", "@") and word else word)
        if value is None:
            assert line["volume_mm2"] == ""
            assert math.isnan(stored)
        else:
            assert stored == value
            assert float(line["volume_mm2"]) == pytest.approx(1e6 * value, rel=1e-11)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[report]\ncolour = 1", r"\[report\] colour: not known"),
        ('[report]\ninclude = ["all"]', "'all' is none of"),
        ('[report]\nleave_out = "trends"', "expected a list"),
        ('[report]\ntimezone = "Mars"', r"\[report\] timezone 'Mars': expected UTC"),
        ("[report]\ntitle = 3", "expected a string"),
        ("report = 3", "must be a table"),
        ('[report.maps]\nx = "none.nc"', "none.nc"),
        ("no toml", "cannot be read as TOML"),
    ],
)
def test_wrong_options_are_said(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "report.toml"
    path.write_text(text)
    with pytest.raises(ReportError, match=message) as caught:
        read_options(path)
    assert "report.toml" in str(caught.value) or "none.nc" in str(caught.value)


def test_options_choose_what_a_page_holds_and_where_it_is_noon(fleet: Path, tmp_path: Path) -> None:
    include = tmp_path / "include.toml"
    include.write_text('[report]\ntitle = "Hall A"\ntimezone = "Asia/Tokyo"\nleave_out = ["guide", "provenance"]\n')
    options = read_options(include)
    assert options.sections == set(SECTIONS) - {"guide", "provenance"}
    page = page_at(build_report(fleet / "hall A" / "one", tmp_path / "r.html", options=options))
    assert page.text.startswith("Hall A")
    assert "JST" in page.text
    assert "How to read this page" not in page.text
    include.write_text('[report]\ninclude = ["quality"]\n')
    bare = page_at(build_report(fleet / "hall A" / "one", tmp_path / "r.html", options=read_options(include)))
    assert bare.tags.count("figure") == 1
    assert "Is it failing?" in bare.text
