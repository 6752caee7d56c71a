"""``spallwatch library learn``: from histories of features to a file, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from monitor.commands.common import InputError
from monitor.commands.feature_files import read_features
from monitor.health.rest.learned.model import LearnedModel
from monitor.records.library_file import LearnedFileError, is_learned, load_learned, save_learned
from tests.support.library_learn import features, learn, learned


def refused(*arguments: object) -> str:
    """Return what is said of wrong input, after the usage where an option itself is wrong."""
    run = learn(*arguments)
    assert isinstance(run.exception, InputError) or run.exit_code == 2
    return f"{run.output}{run.exception}"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("runs")
    return [features(folder / f"{i}.csv", last=30 + 10 * i, seed=i) for i in range(3)]


def test_runs_are_learned_and_said(runs: list[Path], tmp_path: Path) -> None:
    healthy = features(tmp_path / "healthy.csv", last=0)
    short = features(tmp_path / "short.csv", last=7, seed=9)
    out = tmp_path / "machine.json"
    found = learned(*runs, healthy, short, "--out", out)
    assert {"runs", "out", "hash", "crps_share", "coverage", "weights"} <= set(found)
    assert found["runs"] == 3
    assert found["weights"] == {"learned": 1.0}
    assert 0.0 < found["crps_share"] < 0.6
    assert [one["life_s"] for one in found["learned_from"]] == [290.0, 390.0, 490.0]
    reasons = {Path(one["run"]).name: one["reason"] for one in found["left_out"]}
    assert reasons["healthy.csv"] == "no final stage was found"
    assert "7 blocks" in reasons["short.csv"]
    assert found["end_levels"]["geometric_mean"] == pytest.approx(5.4, rel=0.1)
    assert found["end_v_eq_mm2"]["geometric_mean"] is None
    model = load_learned(out)
    assert model.hash == found["hash"]
    table = learn(*runs, short, "--out", tmp_path / "again.npz").stdout
    assert "left out" in table
    assert "coverage" in table
    assert "x baseline" in table
    assert load_learned(tmp_path / "again.npz").settings == model.settings


def test_onset_and_end_may_be_stated(runs: list[Path], tmp_path: Path) -> None:
    ends = [value for _ in runs for value in ("--end-s", "1600")]
    starts = [value for _ in runs for value in ("--t-fs-s", "1450")]
    found = learned(*runs, *ends, *starts, "--out", tmp_path / "l.npz")
    assert [(one["t_fs_s"], one["life_s"]) for one in found["learned_from"]] == [(1450.0, 150.0)] * 3
    # The end may lie after the last block, but what follows it is not used.
    later = learned(runs[0], "--end-s", "5000", "--out", tmp_path / "l.npz")
    assert later["learned_from"][0]["life_s"] == 3600.0
    assert later["crps_share"] is None


def test_axes_and_names_of_columns(tmp_path: Path) -> None:
    late = np.ones(200)
    late[170:] = 4.0
    both = features(tmp_path / "a.csv", axis="h", v_rms_g=late.tolist(), RMS=late.tolist())
    assert learned(both, "--axis", "h", "--out", tmp_path / "l.npz")["learned_from"][0]["t_fs_s"] == 1400.0
    assert learned(both, "--axis", "v", "--out", tmp_path / "l.npz")["learned_from"][0]["t_fs_s"] == 1700.0
    first = learned(both, "--axis", "v", "--axis", "h", "--out", tmp_path / "l.npz")["learned_from"][0]
    assert (first["t_fs_s"], first["axis"]) == (1400.0, "h")
    mapped = learned(both, "--column", "rms_g=RMS", "--out", tmp_path / "l.npz")
    assert mapped["learned_from"][0]["t_fs_s"] == 1700.0
    said = refused(both, "--out", tmp_path / "l.npz")
    assert "column rms_g is missing" in said
    assert "--axis h" in said


def test_volumes_at_the_end_are_kept(tmp_path: Path) -> None:
    runs = [features(tmp_path / f"{i}.csv", v_eq_mm2=[0.01 * 10.0**i] * 200) for i in range(2)]
    found = learned(*runs, "--out", tmp_path / "l.json")
    assert found["end_v_eq_mm2"]["geometric_mean"] == pytest.approx(0.01 * 10.0**0.5)
    assert found["end_v_eq_mm2"]["factor_sd"] > 4.0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("elapsed_s,rms_g\n", "no rows"),
        ("elapsed_s,rms_g\n0,1\n0,1\n", "must increase"),
        ("elapsed_s,rms_g\n0,x\n", "line 2: rms_g is 'x', expected a number"),
        ("elapsed_s,rms_g\n0,nan\n", "expected a finite number"),
        ("elapsed_s,rms_g\n0,0\n1,0\n", "no value above zero"),
        ("elapsed_s,rms_g\n0,1\n1,1\n", "no run can be learned from"),
    ],
)
def test_files_that_are_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "run.csv"
    path.write_text(text)
    assert said in refused(path, "--out", tmp_path / "l.npz")
    assert not (tmp_path / "l.npz").exists()


def test_options_that_are_refused(runs: list[Path], tmp_path: Path) -> None:
    out = ("--out", tmp_path / "l.npz")
    for arguments, said in (
        ((*runs, "--end-s", "1", *out), "one for each of the 3 RUNS, got 1"),
        ((*runs, "--column", "RMS", *out), "is not NAME=COLUMN"),
        ((*runs, "--out", tmp_path / "l.txt"), ".npz"),
        ((runs[0], "--end-s", "-5", *out), "lies before the first block"),
        ((tmp_path / "none.csv", *out), "cannot be read"),
        ((*runs, "--library", tmp_path / "none.npz", *out), "no such library"),
    ):
        assert said in refused(*arguments)


def test_lines_without_their_floor_do_not_date(tmp_path: Path) -> None:
    lines = np.ones(200)
    lines[150:] = 8.0
    without = features(tmp_path / "a.csv", last=60, h_or_g=lines.tolist())
    assert not read_features(without).blocks[0].prominence
    with_floor = features(tmp_path / "b.csv", last=60, h_or_g=lines.tolist(), outer_floor_g=[2.0] * 200)
    assert read_features(with_floor).blocks[160].prominence == {"h_or": 4.0}


def test_files_that_are_no_model_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "l.json"
    save_learned(LearnedModel(), path)
    assert is_learned(path)
    assert load_learned(path).hash == LearnedModel().hash
    path.write_text(path.read_text().replace('"scale": 1.0', '"scale": 0.5'))
    with pytest.raises(LearnedFileError, match="not what was written"):
        load_learned(path)
    for content, said in (
        (b"{}", "expected, got None"),
        (b"PK", "not a learned"),
        (b"[1]", "an object"),
        (b"\xff", "not a"),
    ):
        path.write_bytes(content)
        assert not is_learned(path)
        with pytest.raises(LearnedFileError, match=said):
            load_learned(path)
    np.savez(tmp_path / "other.npz", header=np.array('{"kind": "spallwatch library"}'))
    assert not is_learned(tmp_path / "other.npz")
    with pytest.raises(LearnedFileError, match="library learn"):
        load_learned(tmp_path / "none.json")
