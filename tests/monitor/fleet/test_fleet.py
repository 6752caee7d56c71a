"""The page of an archive says of each recording what its own report says."""

from __future__ import annotations

from models.work.folder_store import open_store
from monitor.fleet.finish import fleet_page
from monitor.fleet.index import Index
from monitor.fleet.result import RecordingResult
from monitor.fleet.run import Results
from monitor.report.runs import read_runs
from monitor.report.verdict import GRADE_NAMES, judge
from tests.monitor.fleet.fleet_files import make_archive, write_files


def test_a_recording_has_the_grade_of_its_report(tmp_path):
    write_files(tmp_path / "worn")
    write_files(tmp_path / "fine", grows_from=99)
    make_archive(tmp_path, '[[machine]]\nname = "m"\nconfig = "m.toml"\nrecordings = ["worn", "fine"]\n')
    grades = {}
    for name in ("worn", "fine"):
        (run,) = read_runs(tmp_path / "out" / "m" / name)
        grades[name] = judge(run, run.channels["de"]).grade
    assert grades["worn"] != grades["fine"]
    store = open_store(tmp_path / "out")
    with Index(tmp_path / "out" / "index.db", read_only=True) as index, Results(index, store) as results:
        for result in results:
            html = fleet_page([result])
            assert "1 recording of 1 machine, 22 blocks: <span" in html
            assert f"1 {GRADE_NAMES[grades[result.recording]]}</span>" in html
        both = fleet_page(results, title="Press shop")
    assert both.index(">worn<") < both.index(">fine<")


def test_a_recording_that_failed_has_its_reason_and_log():
    html = fleet_page(
        [RecordingResult("m", "r", "s3://b/r.csv", "failed", "r.csv: is empty")], logs={("m", "r"): "Traceback: 7"}
    )
    assert "✕ 1 failed" in html
    assert "r.csv: is empty" in html
    assert "Traceback: 7" in html
