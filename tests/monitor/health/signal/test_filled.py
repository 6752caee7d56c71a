"""Lost samples that were filled with a constant are found; no signal that nothing was lost of is taken for one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import signal

from monitor.health.signal.filled import filled_runs
from monitor.health.signal.quality import FLAGS, check_samples, with_flags
from reference import recordings_folder
from tests.support.effort import effort_count

Samples = NDArray[np.float32]
N = 25600
NOISE = np.random.default_rng(20261127).standard_normal(N)
TIME = np.arange(N) / 25600.0


def filtered(edge: float) -> NDArray[np.float64]:
    found = np.asarray(signal.sosfilt(signal.butter(4, edge, output="sos"), NOISE))
    return found / found.std()


SLOW, SLOWER = filtered(0.1), filtered(0.01)
ROUGH = {
    "float32": NOISE,
    "16 bits": np.round(300.0 * NOISE),
    "slow, 12 bits": np.round(300.0 * SLOW),
    "about another level": np.round(3000.0 + 300.0 * NOISE),
    "a tone": np.round(1000.0 * np.sin(2.0 * np.pi * 25.0 * TIME) + 50.0 * NOISE),
}


def fill(samples: NDArray[np.floating], share: float, run: int, value: float | str) -> Samples:
    """Replace a share of the samples in runs by a value, "held" or "mean", at random places."""
    rng = np.random.default_rng(run)
    found = samples.astype(np.float32)
    count = max(1, round(share * samples.size / run))
    part = samples.size // count
    for place in range(0, count * part, part):
        first = max(1, place + int(rng.integers(0, max(1, part - run))))
        held = {"held": found[first - 1], "mean": np.float32(samples.mean())}
        found[first : first + run] = held[value] if isinstance(value, str) else value
    return found


@pytest.mark.parametrize("kind", ROUGH)
@pytest.mark.parametrize("value", [0.0, "held", "mean", 0.7])
@pytest.mark.parametrize("run", [3, 7, 100, 1000])
@pytest.mark.parametrize("share", [0.01, 0.05, 0.39])
def test_filled_samples_are_found(kind: str, value: float | str, run: int, share: float) -> None:
    verdict = check_samples(fill(ROUGH[kind], share, run, value), absolute=False)
    assert verdict.flags == ("filled",)
    assert "of 25600 samples are filled with a constant" in verdict.reason
    assert not verdict.for_baseline
    assert not verdict.for_tracker
    assert verdict.accepted


def test_the_number_of_filled_samples_is_stated() -> None:
    samples = NOISE.astype(np.float32)
    for begin in range(100, N, 256):
        samples[begin : begin + 100] = 0.0
    begins, ends = filled_runs(samples, float(samples.min()), float(samples.max()))
    assert begins.tolist() == list(range(100, N, 256))
    assert set((ends - begins).tolist()) == {100}
    assert check_samples(samples).reason == "10000 of 25600 samples are filled with a constant"


def test_runs_at_the_ends_are_counted_with_others_and_prove_nothing() -> None:
    samples = NOISE.astype(np.float32)
    samples[:300], samples[-200:] = 0.0, 0.0
    assert check_samples(samples).status == "ok"
    samples[5000:5100] = 0.0
    assert check_samples(samples).reason == "600 of 25600 samples are filled with a constant"


def test_neighbouring_runs_of_different_values_are_counted_once() -> None:
    samples = NOISE.astype(np.float32)
    samples[1000:1200], samples[1200:1400] = 0.5, -0.5
    assert check_samples(samples).reason == "400 of 25600 samples are filled with a constant"


def text(values: NDArray[np.float64], digits: int) -> NDArray[np.float64]:
    return np.array([float(f"{value:.{digits}g}") for value in values])


def companded(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values as 8 bits of mu-law hold them."""
    inner = np.round(127.0 * np.log1p(255.0 * np.abs(values)) / np.log(256.0)) / 127.0
    return np.sign(values) * (256.0**inner - 1.0) / 255.0


def impacts(height: float, noise: float) -> NDArray[np.float64]:
    """Return rings of impacts between which the sensor gives few values."""
    since = (TIME * 80.0) % 1.0 / 80.0
    return np.round(height * np.exp(-since / 5e-4) * np.sin(2.0 * np.pi * 4000.0 * since) + noise * NOISE)


SWING = 20.0 * np.sin(2.0 * np.pi * 5.0 * TIME) + 0.004 * NOISE
PULSES = np.where((TIME * 29.5) % 1.0 < 0.1, 5000.0, 0.0)
WHOLE = {
    **{f"noise of {step} steps": np.round(step * NOISE) for step in (0.1, 0.3, 1.0, 2.0, 3.0, 5.0, 10.0, 30.0, 1000.0)},
    **{f"slow noise of {step} steps": np.round(step * SLOWER) for step in (1.0, 10.0, 100.0, 1e4)},
    **{f"a slow tone of {step} steps": np.round(step * np.sin(31.4 * TIME)) for step in (30.0, 3000.0, 1e5)},
    **{f"text of {digits} digits": text(SWING, digits) for digits in (2, 3, 4)},
    **{f"slow text of {digits} digits": text(1.0 + SLOWER, digits) for digits in (2, 3, 4)},
    **{f"clipped at {edge}": np.round(1e3 * np.clip(SLOW, -edge, edge)) for edge in (0.2, 1.0, 2.5)},
    **{f"clipped above {edge}": np.minimum(np.round(1e3 * SLOW), 1e3 * edge) for edge in (0.2, 1.0)},
    **{f"noise on the rail, {edge}": np.round(1e3 * np.clip(SLOW, -edge, edge) + 0.3 * NOISE) for edge in (0.5, 1.5)},
    **{f"impacts of 30, noise {noise}": impacts(30.0, noise) for noise in (0.1, 0.5, 2.0)},
    **{f"impacts of 3000, noise {noise}": impacts(3e3, noise) for noise in (0.1, 0.5, 2.0)},
    "half precision": SWING.astype(np.float16),
    "mu-law": companded(np.clip(SLOWER / 5.0, -1.0, 1.0)),
    "at rest": np.round(0.2 * NOISE + 0.4),
    "pulses": PULSES,
    "pulses in noise": PULSES + np.round(0.3 * NOISE),
    "pulses in more noise": PULSES + np.round(3.0 * NOISE),
    "smooth pulses": np.round(5000.0 * np.exp(-((((TIME * 29.5) % 1.0) - 0.5) ** 2) / 4e-4)),
}  # fmt: skip


@pytest.mark.parametrize("kind", WHOLE)
@pytest.mark.parametrize("size", [2560, N])
def test_a_signal_of_which_nothing_was_lost_has_no_flag(kind: str, size: int) -> None:
    for begin in range(0, N, size):
        samples = WHOLE[kind][begin : begin + size].astype(np.float32)
        assert "filled" not in check_samples(samples, absolute=False).flags


@settings(max_examples=effort_count(quick=30, full=300), deadline=None)
@given(st.floats(0.05, 1e4), st.sampled_from([0.01, 0.05, 0.3, 0.9]), st.integers(1000, 20_000), st.integers(0, 2**32))
def test_quantised_noise_of_any_band_has_no_flag(step: float, edge: float, size: int, seed: int) -> None:
    noise = np.random.default_rng(seed).standard_normal(size)
    band = np.asarray(signal.sosfilt(signal.butter(2, edge, output="sos"), noise))
    samples = np.round(step * band / band.std()).astype(np.float32)
    assert "filled" not in check_samples(samples, absolute=False).flags


def test_what_is_clipped_besides_is_said_of_the_other_samples() -> None:
    clipped = np.clip(np.round(1e3 * SLOW), -1500.0, 1500.0)
    assert check_samples(clipped.astype(np.float32)).flags == ("clipped",)
    assert check_samples(fill(clipped, 0.1, 50, 0.0)).flags == ("clipped", "filled")
    # Zeros below a signal that never comes near them are not its rail.
    assert check_samples(fill(3e3 + 1e2 * NOISE, 0.1, 50, 0.0), absolute=False).flags == ("filled",)


def test_the_flag_is_the_last_one() -> None:
    # Positions of flags are in files.
    assert FLAGS[-1] == "filled"
    filled = check_samples(fill(NOISE, 0.1, 50, 0.0))
    assert with_flags(filled, ("gap", "outside_speed")).flags == ("gap", "outside_speed", "filled")


@pytest.mark.real
def test_no_recorded_row_is_taken_for_filled() -> None:
    import spallwatch as sw

    rows = 0
    for path in sorted(recordings_folder().glob("*/*")):
        if path.suffix in (".mat", ".xz", ".bz2") and (path.parent.name != "femto" or "2_7" in path.name):
            for block in sw.blocks(path, block_s="file", skip_rejected=True):
                for row in block.values:
                    rows += 1
                    assert filled_runs(row, float(row.min()), float(row.max()))[0].size == 0, path
    assert rows > 500
