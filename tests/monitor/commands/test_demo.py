"""``spallwatch demo``: its configuration by model, and what is refused. The pipeline itself: test_rig_line."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from models.solve.registry import IGNORES_DEPTH, RIGS
from models.solve.rotor.rig import RotorRig
from monitor.commands import demo_prior
from monitor.commands.common import InputError
from monitor.commands.demo import MODELS, _prior_note, command, demo_config
from monitor.commands.demo_prior import QUADRATIC, forecast_quadratic
from monitor.commands.sole_writer import sole_writer
from monitor.records.store import Store
from monitor.service.libraries import shipped_library
from tests.support.commands import run_command


def test_the_bench_is_that_of_the_thesis() -> None:
    config = demo_config()
    assert config.bearing[0].designation == "1205 ETN9"
    assert config.forecast.method == "library"
    assert config.detect.end_of_life_peak_g == 20.0


def test_another_model_has_a_bearing_that_it_takes_and_no_library() -> None:
    config = demo_config("filter", "rotor")
    assert config.bearing[0].designation == "6205"
    assert (config.track.method, config.forecast.method) == ("filter", "thesis")
    rig = config.parameters_of(RotorRig, config.bearing[0].to_entry())
    assert rig.calibrated == "declared"
    assert set(MODELS) == set(RIGS) - set(IGNORES_DEPTH) - {"angular", "gear_pair"}


@pytest.mark.parametrize("options", [("--model", "rotor", "--method", "library"), ("--model", "ring_impact")])
def test_what_there_is_not_is_refused(options: tuple[str, ...], tmp_path: Path) -> None:
    arguments = [*options, "--out", str(tmp_path / "out")]
    if "library" in options:
        with pytest.raises(InputError, match=r"the demo has a library of six_dof only.* library build --model rotor"):
            CliRunner().invoke(command, arguments, catch_exceptions=False)
    else:
        result = CliRunner().invoke(command, arguments)
        assert result.exit_code == 2
        assert "'ring_impact' is not one of" in result.output
    assert not (tmp_path / "out").exists()


def test_the_state_of_another_machine_is_not_taken_for_an_earlier_demo(tmp_path: Path) -> None:
    with Store.open(tmp_path / "state.db", machine="press-7"):
        pass
    found = CliRunner().invoke(command, ["--out", str(tmp_path)])
    assert "holds the state of machine 'press-7'; give another folder" in str(found.exception)
    (tmp_path / "state.db").write_bytes(b"no store")
    assert "give another folder" in str(CliRunner().invoke(command, ["--out", str(tmp_path)]).exception)
    assert (tmp_path / "state.db").read_bytes() == b"no store"


def test_v_eq_as_tracked_is_forecast_once_more_by_block(monkeypatch: pytest.MonkeyPatch) -> None:
    assert QUADRATIC.laws == (("quadratic", 1.0),)
    # Another library, since a fit takes seconds: it is about which answer belongs to which block.
    monkeypatch.setattr(demo_prior, "quadratic_library", shipped_library)
    history = [(number + 7, 300.0 * number, 0.002e-6 + 5e-12 * number**2) for number in range(60)]
    whole, half = forecast_quadratic(history), forecast_quadratic(history[:30])
    assert list(whole) == [block for block, _, _ in history]
    assert all(repr(whole[block]) == repr(half[block]) for block in half)
    assert whole[60].status == "ok"


@pytest.mark.parametrize(
    ("tt", "known", "said"),
    [
        (3600.0, 7200.0, r"TT at half of the life would be 2 h.* issued is 60 min, true 1 h 30 min"),
        (None, 7200.0, "issued is none"),
        (3600.0, None, "grows by a quadratic.$"),
    ],
)
def test_the_report_says_what_the_prior_costs(tt: float | None, known: float | None, said: str) -> None:
    row = {"share_of_life": 0.5, "tt_s": tt, "tt_quadratic_s": known, "tt_true_s": 5400.0}
    assert re.search(said, _prior_note([{**row, "share_of_life": 0.25}, row]))


def test_a_demo_does_not_delete_what_another_one_is_writing(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    out.mkdir()
    (out / "report.html").touch()
    with sole_writer(out):
        ended = run_command("demo", "--out", out)
    assert ended.returncode == 2
    assert f"--out {out}: another process is writing it" in ended.stderr
    assert (out / "report.html").exists()
    assert {path.name for path in tmp_path.iterdir()} == {"demo"}
