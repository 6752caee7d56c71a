"""Signals that no sensor gives, that are one signal, or of sensors that alternate; and signals that are neither."""

from __future__ import annotations

import numpy as np
import pytest

from monitor.config.plausible.levels import alternates, doubts, same_signals, shape_of
from streams.files.plausible import level_of

NOISE = np.random.default_rng(1).normal(size=4000)


@pytest.mark.parametrize(
    ("row", "unit", "sensitivity", "words"),
    [
        (NOISE, "g", None, ""),
        (NOISE * 9.81, "m/s2", None, ""),
        (NOISE * 0.1, "V", 100.0, ""),
        (NOISE + 9.81, "g", None, "gravity in m/s2"),
        (NOISE + 1.0, "m/s2", None, "gravity in g"),
        (NOISE * 0.1 + 11.5, "V", 100.0, "bias of an IEPE sensor"),
        (NOISE * 200.0, "g", None, "more than machines have"),
        (NOISE * 1e-6, "g", None, "less than the noise"),
        (np.clip(NOISE, -1.0, 1.0), "g", None, "range of the input"),
        (np.round(np.sin(np.arange(4000.0)), 4), "g", None, ""),
        (np.round(NOISE), "g", None, ""),
        (np.zeros(100), "g", None, "dead sensor"),
        (np.append(NOISE, np.nan), "g", None, "no numbers"),
        (NOISE * 1e300, "g", None, "more than machines have"),
        (NOISE * 1e9, "unknown", None, ""),
    ],
)
def test_levels_that_a_sensor_does_not_give(row: np.ndarray, unit: str, sensitivity: float | None, words: str) -> None:
    found = "; ".join(doubt.came for doubt in doubts(level_of(row), unit, sensitivity))
    assert words in found if words else found == ""


def test_two_channels_of_one_sensor_are_found_whatever_the_factor() -> None:
    other = np.random.default_rng(2).normal(size=4000)
    rows = {"a": NOISE, "b": 9.81 * NOISE + 3.0, "c": other, "d": NOISE + 0.01 * other, "e": np.zeros(4000)}
    ((first, second, factor),) = same_signals(rows)
    assert (first, second) == ("a", "b")
    assert factor == pytest.approx(9.81)
    assert same_signals({"a": NOISE, "b": -NOISE})[0][2] == pytest.approx(-1.0)
    assert same_signals({"a": NOISE, "b": NOISE[:100], "c": NOISE * np.nan}) == []


def test_files_of_two_sensors_alternate_and_those_of_one_do_not() -> None:
    rng = np.random.default_rng(3)
    drifting = [shape_of(rng.normal(size=4000) * (1.0 + 0.1 * number)) for number in range(8)]
    assert [alternates(values) for values in zip(*drifting, strict=True)] == [None] * 3
    two = [shape_of(rng.normal(size=4000) * (1.0 if number % 2 else 0.5)) for number in range(8)]
    assert alternates([rms for rms, *_ in two]) == pytest.approx(2.0, rel=0.1)
    smooth = [np.convolve(rng.normal(size=4000), np.ones(1 + 3 * (number % 2)), "same") for number in range(8)]
    by_frequency = [shape_of(row / row.std()) for row in smooth]
    assert alternates([rms for rms, *_ in by_frequency]) is None
    assert alternates([frequency for _, frequency, _ in by_frequency]) == pytest.approx(2.0, rel=0.1)
    assert alternates([0.0, 1.0] * 2) is None


def test_chance_seldom_alternates() -> None:
    rng = np.random.default_rng(4)
    found = [alternates(rng.normal(0.0, 0.5, size=8).tolist()) for _ in range(2000)]
    assert sum(ratio is not None for ratio in found) <= 2
