"""Makers and checks that tests of tracking share."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.maps import data as map_data
from monitor.health.size.filter.particle_filter import FilterSettings
from monitor.health.size.level_set import LevelMap
from monitor.health.size.library.forecaster import LibrarySettings
from monitor.health.size.library.model import Library
from monitor.health.tracker import (
    DamageSettings,
    PartMap,
    TrackMethod,
)
from tests.oracles.toy_lives import INTERVAL, RADIUS, THRESHOLD

Array = NDArray[np.float64]


LOAD, SPEED = 4000.0, 40.0


METHODS: tuple[TrackMethod, ...] = ("thesis", "filter", "library")


POWERS = np.array([[0.42, 0.72], [0.19, 0.88], [0.1, 0.8], [0.1, 0.7], [0.0, 0.7], [0.0, 0.6]])


def levels(dphi_d: Array, h_d: Array) -> tuple[Array, Array]:
    """RMS and lines of a defect as the toy lives have them, at their reference load and speed."""
    dphi, h = dphi_d / 0.3, h_d / 1e-5
    rms = math.exp(2.0) * dphi**0.1 * h**0.55
    return rms, dphi[..., None] ** POWERS[:, 0] * h[..., None] ** POWERS[:, 1]


@dataclass(frozen=True, eq=False)
class Map:
    """A map as both trackers take it."""

    rms: Array
    lines: Array

    @property
    def axes(self) -> tuple[Array, Array]:
        return np.radians(np.linspace(0.0, 50.0, self.rms.shape[1])), np.linspace(0.0, 32e-6, self.rms.shape[0])

    def narrow(self) -> LevelMap:
        return LevelMap(*self.axes, self.rms, RADIUS)

    def wide(self) -> map_data.MapSlice:
        dphi_d, h_d = self.axes
        none, no_lines = np.zeros_like(self.rms), np.zeros_like(self.lines)
        return map_data.MapSlice(
            LOAD, SPEED, h_d, dphi_d, self.rms, none, self.lines, None, none, no_lines, none, no_lines
        )


def plain_map() -> Map:
    dphi_d, h_d = np.meshgrid(np.radians(np.linspace(0.0, 50.0, 51)), np.linspace(0.0, 32e-6, 33))
    return Map(*levels(dphi_d, h_d))


def settings_of(method: TrackMethod, made: Map, library: Library) -> DamageSettings:
    narrow, wide = made.narrow(), made.wide()
    return DamageSettings(
        track_method=method,
        forecast_method="library" if method == "library" else "thesis",
        maps={
            "outer": PartMap(
                lambda load, speed: (narrow, None),
                lambda load, speed: (wide, None),
                FilterSettings(part_radius=RADIUS, particles=200),
            )
        },
        thresholds=(THRESHOLD,),
        library=library,
        library_settings=LibrarySettings(features="rms+harmonics"),
    )


def growing(count: int = 60) -> tuple[Array, Array, Array]:
    """Times, RMS and lines of a defect that grows as t squared, to 1.2 of the threshold."""
    v_eq = THRESHOLD * (0.06 + 1.14 * np.linspace(0.0, 1.0, count) ** 2)
    h_d = np.asarray(1e-5 * np.sqrt(v_eq / THRESHOLD), dtype=np.float64)
    return (INTERVAL * np.arange(count, dtype=np.float64), *levels(v_eq / (RADIUS * h_d), h_d))
