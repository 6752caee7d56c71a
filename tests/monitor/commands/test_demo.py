"""``spallwatch demo``: its configuration by model, and what is refused. The pipeline itself: test_rig_line."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from models.rigs import IGNORES_DEPTH, RIGS
from models.rigs.rotor import RotorRig
from monitor.commands.common import InputError
from monitor.commands.demo import MODELS, command, demo_config


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
    assert set(MODELS) == set(RIGS) - set(IGNORES_DEPTH) - {"angular"}


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
