"""Makers and checks that tests of filter share."""

from __future__ import annotations

import numpy as np

from models.maps.data import MapSlice
from monitor.health.size import Damage, DamageInput
from monitor.health.size.filter.particle_filter import (
    FilterSettings,
    FilterState,
    step,
)

RADIUS = 0.02291


MM2 = 1e-6


MICRON = 1e-6


SETTINGS = FilterSettings(RADIUS, particles=300)


def toy_map(load: float = 4000.0, speed: float = 40.0, *, spread: float = 0.1) -> MapSlice:
    """RMS sees depth, line 1 depth and extent, the others less clearly; louder with load and speed."""
    dphi_d, h_d = np.radians(np.linspace(0.0, 50.0, 101)), np.linspace(0.0, 32 * MICRON, 33)
    x, y = np.degrees(dphi_d)[None, :], (h_d / MICRON)[:, None]
    level = (load / 4000.0) * (speed / 40.0)
    rms = 3.0 * level * (x + 0.1) ** 0.1 * y**0.55
    lines = [level * a * (x + 0.1) ** p * y**q for a, p, q in ((0.5, 0.42, 0.72), (0.4, 0.2, 0.9), (0.3, 0.1, 0.9))]
    harmonics = np.stack([*lines, *lines], axis=2)
    no_rms, none = np.zeros_like(rms), np.zeros_like(harmonics)
    return MapSlice(
        load=load,
        speed=speed,
        h_d=h_d,
        dphi_d=dphi_d,
        rms=rms,
        rms_error=no_rms,
        harmonic_amplitude=harmonics,
        rms_band=None,
        rms_std=spread * rms,
        harmonic_std=spread * harmonics,
        rms_rig_std=no_rms,
        harmonic_rig_std=none,
    )


TOY = toy_map()


def toy_life(blocks: int = 60, *, seed: int = 1, at: MapSlice = TOY) -> tuple[list[DamageInput], np.ndarray]:
    """A quadratic growth on the toy map, lookup with a gain of 1.1 and 2 % of scatter."""
    rng = np.random.default_rng(seed)
    t = 300.0 * np.arange(blocks)
    v = (0.002 + 0.05 * np.linspace(0.0, 1.0, blocks) ** 2) * MM2
    h_d = 10 * MICRON * (v / (0.05 * MM2)) ** 0.45
    dphi_d = v / (RADIUS * h_d)
    scatter = 1.1 * np.exp(0.02 * rng.standard_normal((blocks, 7)))
    rms = np.hypot(at.interpolate(dphi_d, h_d) * scatter[:, 0], 0.5)
    harmonics = np.hypot(at.interpolate_harmonics(dphi_d, h_d) * scatter[:, 1:], 0.05)
    rows = zip(t.tolist(), rms.tolist(), harmonics.tolist(), strict=True)
    return [DamageInput(time, value, tuple(lines)) for time, value, lines in rows], v


def follow(
    inputs: list[DamageInput], options: FilterSettings = SETTINGS, at: MapSlice = TOY
) -> tuple[FilterState, list[Damage]]:
    state, results = FilterState(), []
    for lookup in inputs:
        state, result = step(state, lookup, map_slice=at, settings=options)
        results.append(result)
    return state, results
