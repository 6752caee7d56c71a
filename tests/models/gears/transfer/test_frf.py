from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from models.gears.transfer.frf import FrequencyResponses, joined
from tests.support.effort import effort_count

RATE = 2048.0


def oscillator(frequency: NDArray[np.float64], resonance: float, damping: float) -> NDArray[np.complex128]:
    """Acceleration over force of 1 kg on a spring and a damper."""
    omega, natural = 2.0 * np.pi * frequency, 2.0 * np.pi * resonance
    return -(omega**2) / (natural**2 - omega**2 + 2j * damping * natural * omega)


def two_by_two(frequency: NDArray[np.float64]) -> FrequencyResponses:
    h = np.stack([oscillator(frequency, f, 0.05) for f in (150.0, 220.0, 300.0, 410.0)], axis=-1)
    return FrequencyResponses(frequency, h.reshape(-1, 2, 2), ("a.x", "a.y"), ("left.x", "left.y"))


def direct(frf: FrequencyResponses, forces: NDArray[np.float64], rate: float) -> NDArray[np.float64]:
    """Sum of cosines, line by line: the oracle of the transform."""
    samples = forces.shape[1]
    t = np.arange(samples) / rate
    found = np.zeros((len(frf.outputs), samples))
    for line in range(1, samples // 2):
        f = line * rate / samples
        if not frf.band[0] <= f <= frf.band[1]:
            continue
        turn = np.exp(2j * np.pi * f * t)
        amplitudes = 2.0 / samples * forces @ turn.conj()
        for o in range(len(frf.outputs)):
            h = np.array([complex(*(np.interp(f, frf.frequency, part) for part in (row.real, row.imag)))
                          for row in frf.h[:, o].T])  # fmt: skip
            found[o] += (h @ amplitudes * turn).real
    return found


def test_a_period_equals_the_sum_over_its_lines() -> None:
    frf = two_by_two(np.arange(60.0, 700.0, 7.0))
    forces = np.random.default_rng(1).normal(size=(2, 256))
    found = frf.apply(forces, RATE, periodic=True)
    np.testing.assert_allclose(found.values, direct(frf, forces, RATE), atol=1e-12)


def test_an_impulse_gives_the_response_of_an_oscillator_at_rest() -> None:
    rate, resonance, damping = 20000.0, 300.0, 0.03
    frequency = np.arange(0.0, 10001.0, 1.0)
    h = oscillator(frequency, resonance, damping) / np.where(frequency == 0.0, 1.0, -((2 * np.pi * frequency) ** 2))
    h[0] = 1.0 / (2.0 * np.pi * resonance) ** 2
    frf = FrequencyResponses(frequency, h[:, None, None], ("a",), ("f",), "m")
    force = np.zeros((1, 4000))
    force[0, 0] = rate
    found = frf.apply(force, rate).values[0]
    t = np.arange(4000) / rate
    natural = 2.0 * np.pi * resonance
    damped = natural * np.sqrt(1.0 - damping**2)
    expected = np.exp(-damping * natural * t) * np.sin(damped * t) / damped
    # The kink at the first sample has lines above the band.
    assert np.abs(found - expected)[1:].max() < 0.002 * expected.max()


def test_nothing_comes_round_from_the_end_of_a_record_that_is_no_period() -> None:
    frf = two_by_two(np.arange(20.0, 900.0, 4.0))
    forces = np.zeros((2, 1024))
    forces[:, 900:] = 1.0
    once, round_again = (frf.apply(forces, RATE, periodic=periodic).values for periodic in (False, True))
    assert np.abs(round_again[:, :100]).max() > 10.0 * np.abs(once[:, :100]).max()


def test_the_share_outside_the_band_is_said_for_each_input() -> None:
    frf = two_by_two(np.arange(100.0, 500.0, 5.0))
    t = np.arange(2048) / RATE
    forces = np.stack(
        [np.cos(2 * np.pi * 200 * t) + 7.0, np.cos(2 * np.pi * 200 * t) + 2.0 * np.cos(2 * np.pi * 600 * t)]
    )
    found = frf.apply(forces, RATE, periodic=True)
    np.testing.assert_allclose(found.outside, [0.0, 0.8], atol=1e-12)
    lines = frf.lines(np.array([200.0, 600.0]), np.ones((2, 2), complex))
    assert lines.inside.tolist() == [True, False]
    assert not lines.amplitudes[1].any()
    np.testing.assert_allclose(lines.amplitudes[0], frf.at(200.0)[0].sum(axis=1))


def test_an_input_that_is_constant_has_nothing_outside() -> None:
    found = two_by_two(np.arange(100.0, 500.0, 5.0)).apply(np.ones((2, 64)), RATE, periodic=True)
    assert found.outside.tolist() == [0.0, 0.0]
    assert np.abs(found.values).max() < 1e-15


@settings(max_examples=effort_count(quick=20, full=500), deadline=None)
@given(
    st.floats(50.0, 5000.0),
    st.floats(0.002, 0.2),
    st.floats(0.01, 1.0),
    st.floats(0.0, 1.0),
)
def test_interpolation_keeps_the_stated_bound(resonance: float, damping: float, width: float, offset: float) -> None:
    """The bound (d / (2 zeta f_n))^2 of a pole, d its width in half bandwidths."""
    step = 2.0 * width * damping * resonance
    frequency = resonance + step * (np.arange(-20.0, 21.0) + offset)
    exact = lambda f: 1.0 / (1.0 + 1j * (f - resonance) / (damping * resonance))  # noqa: E731
    kept = frequency > 0.0
    lines = np.asarray(frequency[kept], np.float64)
    frf = FrequencyResponses(lines, exact(lines)[:, None, None], ("a",), ("f",))
    middle = 0.5 * (frf.frequency[1:] + frf.frequency[:-1])
    error = np.abs(frf.at(middle)[:, 0, 0] - exact(middle)).max()
    assert error <= (step / (2.0 * damping * resonance)) ** 2 * 1.0001


def test_the_estimated_error_of_interpolation_is_that_of_a_fine_grid() -> None:
    for step in (1.0, 2.0, 4.0):
        frequency = np.arange(50.0, 600.0, step)
        frf = FrequencyResponses(frequency, oscillator(frequency, 301.3, 0.03)[:, None, None], ("a",), ("f",))
        fine = np.arange(50.0, 599.0 - step, 0.05)
        exact = oscillator(fine, 301.3, 0.03)
        true = np.abs(frf.at(fine)[:, 0, 0] - exact).max() / np.abs(exact).max()
        assert 0.5 < frf.interpolation_error()[0, 0] / true < 2.0
    assert np.isinf(frf.select().__class__(frequency[:2], frf.h[:2], ("a",), ("f",)).interpolation_error()).all()


def test_chains_selections_shares_and_units() -> None:
    frf = two_by_two(np.arange(100.0, 500.0, 5.0))
    sound = FrequencyResponses(
        np.array([150.0, 400.0]), np.array([[[2.0, 1.0]], [[2.0, 1.0]]]), ("mic",), ("a.y", "a.x"), "Pa", "m/s2"
    )
    chain = frf.then(sound)
    inside = (frf.frequency >= 150.0) & (frf.frequency <= 400.0)
    np.testing.assert_allclose(chain.h[:, 0], (2.0 * frf.h[:, 1] + frf.h[:, 0])[inside])
    assert (chain.output_unit, chain.outputs, chain.inputs) == ("Pa", ("mic",), frf.inputs)
    shared = frf.distributed({"shaft": {"left.x": 0.25, "left.y": -1.0}})
    np.testing.assert_allclose(shared.h[:, :, 0], 0.25 * frf.h[:, :, 0] - frf.h[:, :, 1])
    np.testing.assert_allclose(frf.in_unit("m").in_unit("m/s2").h, frf.h, rtol=1e-14)
    np.testing.assert_allclose(joined([frf.select(["a.x"]), frf.select(["a.y"])]).h, frf.h)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frequency": np.array([1.0, 1.0])}, "ascending, got 1.0 Hz in line 2"),
        ({"frequency": np.array([-1.0, 1.0])}, "not negative and ascending, got -1.0 Hz in line 1"),
        ({"frequency": np.array([1.0])}, "two lines at least"),
        ({"outputs": ("a", "a")}, "outputs must be names, each once"),
        ({"inputs": ("x",)}, r"h must have shape \(f, outputs, inputs\) = \(2, 2, 1\)"),
        ({"h": np.full((2, 2, 2), np.nan)}, "got .*nan.* for a over f in line 1"),
    ],
)
def test_unusable_fields_are_named(change: dict[str, object], message: str) -> None:
    fields: dict[str, object] = {
        "frequency": np.array([1.0, 2.0]), "h": np.zeros((2, 2, 2)), "outputs": ("a", "b"), "inputs": ("f", "g")
    }  # fmt: skip
    with pytest.raises(ValueError, match=message):
        FrequencyResponses(**(fields | change))  # type: ignore[arg-type]


def test_unusable_calls_are_named() -> None:
    frf = two_by_two(np.arange(0.0, 500.0, 5.0))
    with pytest.raises(ValueError, match=r"\(inputs, samples\) = \(2, 2 or more\), got \(3, 9\)"):
        frf.apply(np.zeros((3, 9)), RATE)
    with pytest.raises(ValueError, match="forces must be finite"):
        frf.apply(np.full((2, 9), np.inf), RATE)
    with pytest.raises(ValueError, match="rate must be positive"):
        frf.apply(np.zeros((2, 9)), 0.0)
    with pytest.raises(ValueError, match=r"unknown input 'b'; there are left.x, left.y"):
        frf.distributed({"s": {"b": 1.0}})
    with pytest.raises(ValueError, match="at 0 Hz do not tell those in m/s"):
        frf.in_unit("m/s")
    with pytest.raises(ValueError, match="inputs that follow must be in m/s2, got N"):
        frf.then(frf)
    near = FrequencyResponses(np.array([1.0, 1.0 + 1e-7]), np.zeros((2, 1, 1), complex), ("a",), ("f",))
    with pytest.raises(ValueError, match=r"lines 1e-07 Hz apart .* need a transform"):
        near.apply(np.zeros((1, 9)), RATE)
    with pytest.raises(ValueError, match="two lines in common"):
        frf.then(
            FrequencyResponses(np.array([900.0, 990.0]), np.zeros((2, 1, 1), complex), ("m",), ("a.x",), "Pa", "m/s2")
        )
    with pytest.raises(ValueError, match="same lines"):
        joined([frf, near])
