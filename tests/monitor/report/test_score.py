from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from monitor.commands.score import command
from monitor.health.record import Record
from monitor.report.score.forecasts import Issued, ScoreError, read_issued
from monitor.report.score.scoring import End, end_of, mean_of_runs, score_run
from tests.support.score import DAY, KNOWN, STEP, TT, record, run, stored


def only(path: Path, threshold: float | None = None) -> Issued:
    (issued,) = read_issued(path, threshold)
    return issued


def test_a_run_is_scored_by_hand(tmp_path: Path) -> None:
    issued = only(stored(tmp_path, run()))
    assert issued.time.tolist() == [500.0, 600.0, 700.0, 800.0, 900.0, 1000.0]
    assert issued.onset == 300.0
    found = score_run(issued, End(1000.0, "given"))
    assert (found["forecasts"], found["missing"], found["answered"]) == (5, "left_out", 0.8)
    # r* = 500, 400, 300, 200, 100; r = 500, -, 200, 260, 90
    assert found["cra"] == pytest.approx((1.0 + 2.0 / 3.0 + 0.7 + 0.9) / 4.0)
    assert found["crps_s"] == pytest.approx((0.0 + 100.0 + 60.0 + 10.0) / 4.0)
    assert found["crps_share"] == pytest.approx(found["crps_s"] / 700.0)
    # Half-way is 750 s: the forecast of 700 s stood, which is a third off.
    assert (found["alpha_lambda"], found["alpha_lambda_mass"]) == (False, 0.0)
    # The band is 20 % of 500 s: all from 700 s on are within 100 s.
    assert found["prognostic_horizon_s"] == 300.0
    assert (found["coverage"], found["width_s"], found["interval"]) == (None, None, None)
    assert (found["lifetime_s"], found["end_s"], found["end_source"]) == (700.0, 1000.0, "given")
    assert set(found["baselines"]) == {"doubling", "linear", "exponential", "thesis"}
    # V_eq grows in a straight line that reaches 0.05 mm3/mm with block 11.
    assert found["baselines"]["linear"]["crps_s"] == pytest.approx(0.0, abs=1e-6)
    assert found["baselines"]["linear"]["answered"] == 0.8


def test_forecasts_of_a_final_stage_that_closed_again_are_not_scored_but_its_alarm_was_false(tmp_path: Path) -> None:
    """The first stage of blocks 2 and 3 is over before the one that the run ends with."""
    early = {"t_fs": 0.0, "t_fs_known": STEP, "stage": "final", "tt": 100.0, "tt_status": "ok", "edv_status": "ok"}
    over = {"tt_status": "episode_closed", "edv_status": "episode_closed"}
    issued = only(stored(tmp_path, run(more={2: early, 3: early, 4: over})))
    assert issued.time.tolist() == [500.0, 600.0, 700.0, 800.0, 900.0, 1000.0]
    assert issued.onset == 300.0
    assert issued.alarms.tolist() == [STEP, 500.0]


def test_a_missing_answer_is_the_constant_guess_where_there_is_a_population(tmp_path: Path) -> None:
    issued = only(stored(tmp_path, run()))
    found = score_run(issued, End(1000.0, "given"), lifetimes=(800.0, 900.0, 1000.0))
    # At 600 s the median life of 900 s leaves 600, and 400 are true.
    assert found["crps_s"] == pytest.approx((0.0 + 200.0 + 100.0 + 60.0 + 10.0) / 5.0)
    assert (found["missing"], found["answered"]) == ("constant", 0.8)
    assert found["baselines"]["constant"]["crps_s"] == pytest.approx(200.0)
    assert found["baselines"]["climatology"]["crps_s"] == pytest.approx(
        found["crps_s"] / found["crps_over_climatology"]
    )
    assert found["baselines"]["elapsed_alone"]["crps_s"] < found["baselines"]["climatology"]["crps_s"]


@pytest.mark.parametrize("start", [0.0, DAY, 1.9 * DAY])
def test_figures_do_not_depend_on_the_clock(tmp_path: Path, start: float) -> None:
    undated = score_run(only(stored(tmp_path / "a", run())), End(1000.0, "given"), lifetimes=(500.0, 900.0))
    issued = only(stored(tmp_path / "b", run(start=start)))
    dated = score_run(issued, end_of(issued, start + 1000.0), lifetimes=(500.0, 900.0))
    assert (dated.pop("end_utc_s"), undated.pop("end_s")) == (start + 1000.0, 1000.0)
    for values in (dated, undated):
        del values["records"]
    assert dated == undated


def intervals(tail: dict[str, float] | None = None) -> list[Record]:
    more: dict[int, dict[str, Any]] = {}
    for sequence, answer in enumerate(TT, KNOWN):
        if answer is not None:
            more[sequence] = {"tt_lower": 0.6 * answer, "tt_upper": 1.6 * answer}
            if tail is not None:
                levels = {"0.1": 0.6, "0.5": 1.0, "0.9": 1.6, **tail}
                more[sequence]["quantiles_s"] = {p: share * answer for p, share in levels.items()}
    return run(more=more)


def test_intervals_are_read_from_records_as_from_the_archive(tmp_path: Path) -> None:
    folder = stored(tmp_path, intervals(), published=True, interval_level=0.8, forecast_method="library")
    archive, records = only(folder), only(folder / "records")
    assert (archive.source, records.source) == ("archive", "records")
    assert (archive.method, records.method) == ("library", "library")
    assert archive.levels.tolist() == records.levels.tolist() == [0.1, 0.5, 0.9]
    np.testing.assert_array_equal(archive.quantiles, records.quantiles)
    found = score_run(archive, End(1000.0, "given"))
    # Intervals 300-800, 120-320, 156-416, 54-144 around 500, 300, 200, 100.
    assert (found["coverage"], found["width_s"]) == (1.0, pytest.approx((500.0 + 200.0 + 260.0 + 90.0) / 4.0))
    again = score_run(records, End(1000.0, "given"))
    assert {**found, "records": "", "issued_in": ""} == {**again, "records": "", "issued_in": ""}


def test_the_archive_holds_more_of_a_distribution_than_the_records(tmp_path: Path) -> None:
    folder = stored(tmp_path, intervals({"0.02": 0.1, "0.98": 6.0}), published=True, interval_level=0.8)
    archive, records = only(folder), only(folder / "records")
    assert (archive.levels.size, records.levels.size) == (5, 3)
    one, other = (score_run(issued, End(1000.0, "given")) for issued in (archive, records))
    assert one["coverage"] == other["coverage"]
    assert one["width_s"] == pytest.approx(other["width_s"])
    assert one["crps_s"] != pytest.approx(other["crps_s"], rel=1e-3)


def test_intervals_of_unsaid_level_are_refused(tmp_path: Path) -> None:
    folder = stored(tmp_path, intervals(), published=True)
    with pytest.raises(ScoreError, match="attribute interval_level must be"):
        read_issued(folder / "records")


def test_standstill_is_no_damage_time(tmp_path: Path) -> None:
    """Blocks 8 and 9 stand still, so that from block 7 to block 10 no time passes."""
    records = run()
    for place in (7, 8):
        values = dict(records[place - 0].channels["x"])
        values |= {"quality_status": "stopped", "quality_flags": ("stopped",), "tt": None, "tt_status": "concave"}
        records[place] = record(place + 1, values, start=None, flags=("stopped",))
    issued = only(stored(tmp_path, records))
    assert issued.clock.tolist() == [500.0, 600.0, 600.0, 600.0, 600.0, 700.0]
    assert issued.to_clock(1300.0) == 1000.0
    end = end_of(issued, 1000.0)
    assert end.clock == 700.0
    # Blocks 6 and 10 answered 500 and 90 s; 200 and 100 s were left.
    assert score_run(issued, end)["crps_s"] == pytest.approx((300.0 + 10.0) / 2.0)


def test_the_end_is_given_or_true_or_tracked_or_unknown(tmp_path: Path) -> None:
    issued = only(stored(tmp_path / "a", run()))
    assert end_of(issued, 1500.0) == End(1500.0, "given")
    assert end_of(issued, None, tracked=True).clock == pytest.approx(1000.0)
    assert end_of(issued, None).source == "none"
    truth = {n: {"v_eq_true": 1e-9 * max(0, n - 3), "tt_true": 40.0 + STEP * (10 - n)} for n in range(1, 11)}
    simulated = only(stored(tmp_path / "b", run(more=truth)))
    assert end_of(simulated, None, tracked=True) == End(940.0, "truth")
    assert end_of(simulated, 990.0) == End(990.0, "given")
    found = score_run(simulated, end_of(simulated, None))
    assert (found["onset_delay_s"], found["false_alarms"]) == (200.0, 0)
    assert found["v_eq_ln_error"] == pytest.approx(
        math.sqrt(np.mean([math.log(5.0 * (n - 1) / (n - 3)) ** 2 for n in range(6, 11)]))
    )


def test_an_alarm_before_the_onset_is_false(tmp_path: Path) -> None:
    found = score_run(only(stored(tmp_path, run())), End(1000.0, "given"), onset=850.0)
    assert (found["onset_delay_s"], found["false_alarms"]) == (None, 1)
    assert found["false_alarms_per_1000_blocks"] == pytest.approx(1000.0 / 9.0)
    later = score_run(only(tmp_path), End(1000.0, "given"), onset=450.0)
    assert (later["onset_delay_s"], later["false_alarms"]) == (50.0, 0)


def test_a_run_that_ended_before_its_first_forecast_has_no_figures(tmp_path: Path) -> None:
    found = score_run(only(stored(tmp_path, run())), End(400.0, "given"), lifetimes=(500.0, 900.0))
    assert found["forecasts"] == 0
    assert {found[name] for name in ("cra", "alpha_lambda", "prognostic_horizon_s", "crps_s", "coverage")} == {None}
    assert found["baselines"]["climatology"]["crps_s"] is None


def test_means_are_over_runs_and_not_over_channels() -> None:
    def scored(records: str, crps: float | None) -> dict[str, Any]:
        keys = ("cra", "alpha_lambda", "prognostic_horizon_s", "convergence_s", "coverage", "width_s", "answered")
        rest = dict.fromkeys((*keys, "crps_share", "onset_delay_s", "false_alarms_per_1000_blocks"))
        return {"records": records, "machine": "m", "crps_s": crps, "baselines": {"linear": {"crps_s": 7.0}}, **rest}

    runs = [scored("a", 1.0), scored("a", 3.0), scored("b", 8.0), scored("c", None)]
    found = mean_of_runs(runs)
    assert found["crps_s"] == {"mean": 5.0, "standard_error": pytest.approx(3.0), "runs": 2}
    assert found["baselines.linear.crps_s"] == {"mean": 7.0, "standard_error": 0.0, "runs": 3}
    assert "coverage" not in found


def invoke(*arguments: str | Path) -> dict[str, Any]:
    result = CliRunner().invoke(command, [*map(str, arguments), "--json"], catch_exceptions=False)
    assert result.exit_code == 0
    return json.loads(result.stdout)


def test_the_command_scores_runs_beside_lifetimes_of_the_others(tmp_path: Path) -> None:
    folders = [stored(tmp_path / name, run(), machine=name) for name in ("a", "b", "c")]
    ends = [("--end-s", end) for end in ("1000", "1100", "1300")]
    found = invoke(*folders, *(word for pair in ends for word in pair))
    keys = {"cra", "alpha_lambda", "prognostic_horizon_s", "crps_s", "coverage", "width_s", "onset_delay_s"}
    for scored in found["runs"]:
        assert keys | {"false_alarms", "baselines", "convergence_s"} <= set(scored)
    assert [scored["lifetime_s"] for scored in found["runs"]] == [700.0, 800.0, 1000.0]
    assert found["mean"]["crps_s"]["runs"] == 3
    alone = invoke(folders[0], "--end-s", "1000", "--lifetime-s", "800", "--lifetime-s", "1000")
    assert alone["runs"][0] == found["runs"][0]
    assert invoke(folders[0], "--threshold-mm2", "0.05")["runs"][0]["end_source"] == "tracked"


def test_scores_made_through_chunks_are_those_of_a_plain_loop_and_records_that_changed_are_read_again(
    tmp_path: Path,
) -> None:
    folders = [stored(tmp_path / name, run(), machine=name) for name in ("a", "b", "c")]
    arguments = (*folders, "--end-s", "1000", "--end-s", "1100", "--end-s", "1300")
    plain = invoke(*arguments)
    shared = (*arguments, "--workers", "1", "--chunks", tmp_path / "chunks", "--resume")
    for kept in (0, 6):
        found = invoke(*shared)
        assert (found["runs"], found["mean"]) == (plain["runs"], plain["mean"])
        assert (found["cluster"]["chunks"], found["cluster"]["kept"]) == (6, kept)
    database = folders[0] / "state.db" if folders[0].is_dir() else folders[0]
    later = database.stat().st_mtime + 1.0
    os.utime(database, (later, later))
    assert invoke(*shared)["cluster"]["kept"] == 5


def test_the_command_says_it_in_words(tmp_path: Path) -> None:
    folders = [stored(tmp_path / name, run(), machine=name) for name in ("a", "b", "c")]
    arguments = [*map(str, folders), "--end-s", "1000", "--end-s", "1100", "--end-s", "400", "--onset-s", "350"]
    result = CliRunner().invoke(command, [*arguments, "--onset-s", "350", "--onset-s", "350"], catch_exceptions=False)
    assert "5 forecasts for 0.05 mm3/mm before the end (as given)" in result.output
    assert "onset known after 2.5 min, 0 false alarms" in result.output
    assert "alpha-lambda (20 %, half-way): failed" in result.output
    assert result.output.count("- climatology") == 2  # the run that ended before its first forecast has no table
    assert "means over 3 runs" in result.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "no end is known; give --end-s, or --threshold-mm2"),
        (["--end-utc", "2026-01-01"], "is undated; give --end-s rather than --end-utc"),
        (["--end-s", "5", "--end-s", "6"], "--end-s: expected one for each of the 1 RECORDS, got 2"),
        (["--end-s", "-5"], "--end-s: lies before the first record of"),
        (["--end-s", "5", "--end-utc", "2026-01-01"], "give one of them"),
        (["--end-s", "900", "--onset-utc", "2026-01-01"], "give --onset-s rather than --onset-utc"),
        (["--threshold-mm2", "0.07"], "--threshold-mm2 0.07: channel 'x' was forecast for 0.05 mm3/mm"),
    ],
)
def test_what_cannot_be_scored_is_refused(tmp_path: Path, arguments: list[str], message: str) -> None:
    folder = stored(tmp_path / "run", run())
    result = CliRunner().invoke(command, [str(folder), *arguments])
    assert message in str(result.exception)
    assert {"InputError", "ReportError"} & {kind.__name__ for kind in type(result.exception).__mro__}


def test_a_threshold_that_was_not_reached_gives_no_end(tmp_path: Path) -> None:
    low = {n: {"v_eq": 1e-9} for n in range(KNOWN, 12)}
    result = CliRunner().invoke(command, [str(stored(tmp_path, run(more=low))), "--threshold-mm2", "0.05"])
    assert "never reached --threshold-mm2 0.05" in str(result.exception)


def test_records_without_forecasts_and_with_several_thresholds_are_refused(tmp_path: Path) -> None:
    nothing = stored(tmp_path / "a", [record(1, {"rms": 1.0}, start=None)])
    with pytest.raises(ScoreError, match="no channel has a forecast"):
        read_issued(nothing)
    both = {"v_th": (3e-8, 5e-8)}
    several = {
        n: both | {"tt": (10.0, 20.0), "tt_status": ("ok", "ok"), "tt_true": (40.0, 70.0)} if n >= KNOWN else both
        for n in range(1, 12)
    }
    several[KNOWN - 1] = both | {"tt_status": ("not_final_stage", "not_final_stage")}
    folder = stored(tmp_path / "b", run(more=several), published=True) / "records"
    with pytest.raises(ScoreError, match=r"forecast for 0.03, 0.05 mm3/mm; say which: --threshold-mm2"):
        read_issued(folder)
    assert only(folder, 5e-8).quantiles[:, 0].tolist() == [20.0] * 6
    assert only(folder, 3e-8).end_true == 540.0
