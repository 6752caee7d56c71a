"""``spallwatch gear --frf`` and ``--atv``: levels on the casing and in the air, and what is refused."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.gears.sound.transfer_files import write_transfer_vectors
from models.gears.sound.transfer_vectors import TransferVectors
from models.gears.sound.wav import read_wav
from models.gears.transfer.frf import FrequencyResponses
from monitor.commands.common import InputError
from monitor.gears.config.section import GearSection
from monitor.gears.forces import GearRun, amplitudes
from monitor.gears.frf_files import frf_to_csv
from monitor.gears.transfer import (
    CasingResponses,
    bands_within,
    casing_of,
    felt,
    heard,
    motion_lines,
    motion_values,
    pressure_values,
)
from streams.types.block import STANDARD_GRAVITY
from tests.support.commands import run_command
from tests.support.gear_forces import RATE, VARIED, run_of, toml

GEAR = GearSection.model_validate(VARIED)
INPUTS = tuple(f"b{n}.{axis}" for n in range(3) for axis in "xy")
FREQUENCY = np.linspace(100.0, 9000.0, 300)


def flat(
    gains: list[list[float]], outputs: tuple[str, ...] = ("left", "right"), unit: str = "m/s2"
) -> FrequencyResponses:
    """Return responses without resonance: outputs are sums of the forces."""
    h = np.broadcast_to(np.array(gains, np.complex128), (FREQUENCY.size, len(outputs), len(INPUTS)))
    return FrequencyResponses(FREQUENCY, h, outputs, INPUTS, unit)


GAINS = [[0.01, 0.0, 0.0, 0.02, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, -0.03]]


@pytest.fixture(scope="module")
def run() -> GearRun:
    return run_of(VARIED, duration=0.5)


def test_a_casing_without_resonance_moves_as_the_forces_do(run: GearRun) -> None:
    casing = casing_of(GEAR, flat(GAINS), "--frf", None)
    assert casing.motion is not None
    found = felt(run, casing.motion, casing.lead)
    lines = run.lines_hz[1:4]
    expected = [
        0.01 * run.forces["b0"][:, 0] + 0.02 * run.forces["b1"][:, 1],
        -0.03 * run.forces["b2"][:, 1],
    ]
    at = round(casing.lead * RATE)
    for got, wanted in zip(found.values, expected, strict=True):
        both = np.abs(amplitudes(np.stack([got, wanted[at:-at]], axis=1), RATE, lines))
        assert both[:, 0] == pytest.approx(both[:, 1], rel=0.01)


def test_levels_of_bands_add_up_to_the_rms(run: GearRun) -> None:
    responses = flat(GAINS)
    found = felt(run, responses, 0.05)
    values = motion_values(found)
    for one, record in zip(values["outputs"], found.values, strict=True):
        level = 20.0 * math.log10(one["rms_g"] * STANDARD_GRAVITY / 1e-6)
        # Bands end at 7 kHz, the responses at 9 kHz; nothing of the meshes' first harmonics is above.
        assert one["level_db"] == pytest.approx(level, abs=0.2)
        assert one["rms_g"] == pytest.approx(float(np.std(record)) / STANDARD_GRAVITY)
    assert len(values["bands_hz"]) == len(values["outputs"][0]["bands_db"])
    assert 0.0 < values["outside_share"] < 0.2
    assert "lies outside" in next(motion_lines(values))


def test_measured_bands_that_end_at_rounded_edges_count() -> None:
    # The appendix says 562 to 2818 Hz for the bands from 630 to 2500 Hz, whose edges are 562.34 and 2818.38 Hz.
    assert bands_within((562.0, 2818.0), 51200.0, 1.0).nominal == (630, 800, 1000, 1250, 1600, 2000, 2500)
    assert bands_within((562.0, 2818.0), 5000.0, 1.0).nominal[-1] == 2000
    with pytest.raises(InputError, match="no third-octave band lies within 600 to 700 Hz"):
        bands_within((600.0, 700.0), 51200.0, 1.0)


def vectors(points: tuple[str, ...], **more: object) -> TransferVectors:
    """Return transfer vectors of one microphone: 400 Pa s/m of the first point, 0 of the others."""
    grid = np.linspace(40.0, 9500.0, 50)
    h = np.zeros((grid.size, 1, len(points)), np.complex128)
    h[:, 0, 0] = 400.0
    return replace(TransferVectors(grid, h, ("mic",), points), **more)  # pyright: ignore[reportArgumentType]


def test_sound_follows_from_the_velocity_of_the_surface(run: GearRun) -> None:
    pressure, used = heard(flat(GAINS), vectors(("left",)), "--frf", "--atv")
    assert (used, pressure.output_unit) == ({"left"}, "Pa")
    # p = 400 v, v = a / (i omega)
    assert pressure.h[10, 0, 3] == pytest.approx(400.0 * 0.02 / (2j * math.pi * pressure.frequency[10]))
    found = felt(run, pressure, 0.05)
    values = pressure_values(found)["microphones"][0]
    a, p = (amplitudes(felt(run, one, 0.05).values[:1].T, RATE, run.lines_hz[:3]) for one in (flat(GAINS), pressure))
    assert np.abs(p / a)[:, 0] == pytest.approx(400.0 / (2.0 * math.pi * run.lines_hz[:3]), rel=1e-3)
    k = list(found.bands.nominal).index(1000)
    assert values["bands_dba"][k] == pytest.approx(values["bands_db"][k], abs=1.5)
    low = list(found.bands.nominal).index(315)
    assert values["bands_dba"][low] == pytest.approx(values["bands_db"][low] - 6.6, abs=0.7)


def test_a_point_may_be_given_by_its_directions() -> None:
    outputs = ("p.x", "p.y", "p.z")
    gains = [[1.0] + 5 * [0.0], [0.0, 1.0] + 4 * [0.0], 6 * [0.0]]
    normal = np.array([[0.6, -0.8, 0.0]])
    found, used = heard(flat(gains, outputs, "m/s"), vectors(("p",), normal=normal), "--frf", "--atv")
    assert used == {"p.x", "p.y"}
    assert found.h[0, 0, :2] == pytest.approx([240.0, -320.0])


@pytest.mark.parametrize(
    ("responses", "said"),
    [
        (flat(GAINS).select(inputs=INPUTS[1:]), ["no response to 'b0.x'", "NAME.x", "b0.y, b1.x"]),
        (replace(flat(GAINS), input_unit="m/s"), ["in N", "found m/s"]),
        (replace(flat(GAINS), output_unit="N"), ["m, m/s, m/s2 or Pa", "found N"]),
    ],
)
def test_responses_that_do_not_fit_are_refused(responses: FrequencyResponses, said: list[str]) -> None:
    with pytest.raises(InputError) as raised:
        casing_of(GEAR, responses, "--frf f.csv", None)
    for words in ["--frf f.csv", *said]:
        assert words in str(raised.value)


def test_vectors_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InputError, match=r"no output for the point 'other' of --atv; expected other$"):
        heard(flat(GAINS), vectors(("other",)), "--frf", "--atv")
    with pytest.raises(InputError, match="fewer than two lines in common"):
        heard(flat(GAINS), vectors(("left",), frequency=np.linspace(1e4, 2e4, 50)), "--frf", "--atv")
    with pytest.raises(InputError, match=r"--atv a.npz: needs the motion of the surface"):
        casing_of(GEAR, replace(flat(GAINS), output_unit="Pa"), "--frf", Path("a.npz"))


def test_a_record_that_is_too_short_for_a_band_is_refused(run: GearRun) -> None:
    with pytest.raises(InputError, match=r"resolved in 0 s; give a longer --duration-s"):
        felt(run, flat(GAINS), 0.24)
    # 12 lines in a band 0.23 times as wide as its frequency: from 219 Hz on in a quarter of a second.
    assert bands_within((10.0, 9000.0), RATE, 0.25).nominal[0] == 250
    assert CasingResponses(None, None).lead == 0.0


def test_the_command_goes_from_teeth_to_a_sound(tmp_path: Path) -> None:
    (tmp_path / "gear.toml").write_text(toml(VARIED))
    (tmp_path / "frf.csv").write_text(frf_to_csv(flat(GAINS)))
    write_transfer_vectors(tmp_path / "atv.npz", vectors(("left",)))
    arguments = ("--config", "gear.toml", "--duration-s", 0.4, "--rate-hz", RATE, "--frf", "frf.csv")
    done = run_command("gear", *arguments, "--atv", "atv.npz", "--wav", "s.wav", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    assert [one["name"] for one in values["casing"]["outputs"]] == ["right"]
    level = values["sound"]["microphones"][0]["level_db"]
    sound = read_wav(tmp_path / "s.wav")
    assert sound.full_scale == values["sound"]["full_scale_pascal"]
    assert 20.0 * math.log10(float(sound.pressure.std()) / 20e-6) == pytest.approx(level, abs=0.2)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--atv", "a.npz"], "--atv a.npz: needs --frf"),
        (["--frf", "f.csv", "--wav", "s.wav"], "--wav s.wav: there is no sound"),
        (["--frf", "f.txt"], "--frf f.txt: expected a name that ends in .csv, .uff or .unv"),
        (["--frf", "none.csv"], "--frf none.csv: cannot be read"),
        (["--frf", "gear.csv"], "gear.csv, line 1: expected the columns frequency_hz,output,input"),
        (["--frf", "f.csv", "--atv", "none.npz"], "none.npz: cannot be read"),
    ],
)
def test_files_that_cannot_be_used_are_named(options: list[str], said: str, tmp_path: Path) -> None:
    (tmp_path / "gear.toml").write_text(toml(VARIED))
    (tmp_path / "gear.csv").write_text("a,b\n1,2\n")
    (tmp_path / "f.csv").write_text(frf_to_csv(flat(GAINS)))
    done = run_command("gear", "--config", "gear.toml", *options, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr
