"""``spallwatch cyclic`` and its Python interface: lines that recur with the shaft, drawn and as numbers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import spallwatch as sw
from models.words.errors import WrongInputError
from monitor.commands.orders import cyclic_command as command
from tests.support.cyclic import RATE, hunting, modulated


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cyclic") / "winch.csv"
    turns = hunting().turns_at(np.arange(int(RATE * hunting().duration)) / RATE)
    shaft = sum(np.cos(2.0 * np.pi * order * turns + order) for order in range(1, 6))
    np.savetxt(path, modulated(hunting(), 0.9, 5.39) + 0.5 * shaft, "%.5f")
    return path


def test_lines_are_found_along_the_angle_from_the_vibration(recording: Path, tmp_path: Path) -> None:
    given = [str(recording), "--rate-hz", str(RATE), "--block-s", "4", "--bearing", "6205"]
    plot = tmp_path / "winch.svg"
    result = CliRunner().invoke(command, [*given, "--speed-range-hz", "14", "28", "--plot", str(plot), "--json"])
    assert result.exit_code == 0, result.output
    values = json.loads(result.output)
    assert values["domain"] == "order"
    assert values["speed_max_hz"] == pytest.approx(24.0, rel=0.02)
    assert values["lines"]["inner"]["stands_out"]
    assert values["lines"]["inner"]["found"] == pytest.approx(5.39, abs=0.01)
    assert "inner race" in plot.read_text(encoding="utf-8")
    text = CliRunner().invoke(command, [*given, "--speed-hz", "20"]).output
    assert "turns at 20 Hz" in text


def test_what_is_refused(recording: Path) -> None:
    given = [str(recording), "--rate-hz", str(RATE), "--block-s", "4", "--bearing", "6205"]
    for options, words in (
        ([], "the speed is not known"),
        (["--speed-hz", "20", "--speed-range-hz", "14", "28"], "exclude each other"),
        (["--speed-range-hz", "100", "140"], "cannot_tell"),
    ):
        result = CliRunner().invoke(command, [*given, *options])
        assert isinstance(result.exception, WrongInputError)
        assert words in str(result.exception)


def test_the_python_interface() -> None:
    signal = sw.to_signal(modulated(hunting(), 0.9, 5.39), rate_hz=RATE, unit="g")
    pulses = hunting().time_at(np.arange(1, int(hunting().turned)))
    found = sw.cyclic_coherence(signal, bearing="6205", pulses_s=pulses)
    assert found.dims == ("frequency", "order")
    assert found.enhanced.idxmax().item() == pytest.approx(5.39, abs=0.01)
    assert found.enhanced.max() > 10.0 * found.attrs["limit"]
    figure = sw.plot_cyclic(found, "6205")
    assert figure.subfigs or figure.axes
    with pytest.raises(sw.SignalError, match="speed is not known"):
        sw.cyclic_coherence(signal, bearing="6205")
    with pytest.raises(sw.SignalError, match="one channel"):
        sw.cyclic_coherence(np.zeros((2, 10)), bearing="6205", rate_hz=RATE, unit="g")
