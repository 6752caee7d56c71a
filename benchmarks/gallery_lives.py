"""Six simulated lives in place of the thesis' run-to-failure tests, for the figures of its chapter 5.

The measured histories are not at hand. A twin of a test has its load, speed, onset and end (Tables 3 and 20), and its
true damaged volume follows the quadratic that Table 22 prints for it up to 0.05 mm3/mm. What the print does not tell is
chosen: from there the volume grows faster, to 0.5 mm3/mm at the end (44 degrees; the tests ended at about 50); the
sizes grow in proportion (50 degrees to 32 um), the floor is rough and another than those of the map, and the sensor's
noise is white.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import from_catalogue, kinematics
from models.machine.scene import Defect, Floor, Scene
from models.maps.build import build_map
from models.maps.data import RmsMap
from models.maps.plan import MapPlan
from models.path.defect import race_radius
from models.solve.simulate import simulate
from monitor.health.rest.quadratic import ForecastState, QuadraticFit
from monitor.health.rest.quadratic import step as forecast
from monitor.health.signal.features import BlockFeatures, FeatureSettings, block_features, fundamentals
from monitor.health.size import EdvStatus, Remaining
from monitor.health.size.edv import EdvSettings, EdvState
from monitor.health.size.edv import step as track
from monitor.service.setup import to_slice
from tests.oracles.quadratic_oracle import fit_quadratic

Values = NDArray[np.float64]

MINUTE, MM2 = 60.0, 1e-6
SPEED = 40.0
BAND = (0.0, 9500.0)
ENVELOPE_BAND = (7000.0, 9000.0)
V_TH, V_END = 0.05 * MM2, 0.5 * MM2
TESTS = ("E1", "E2", "E3", "E4", "E5", "E6")
LOADS = {"E1": 4000.0, "E2": 4000.0, "E3": 4000.0, "E4": 3000.0, "E5": 4700.0, "E6": 5000.0}
"""N (Table 3)."""
ONSETS = {"E1": 24255, "E2": 9505, "E3": 11180, "E4": 28020, "E5": 8220, "E6": 1700}
"""t_fs, minutes (Table 20)."""
LENGTHS = {"E1": 325, "E2": 415, "E3": 730, "E4": 415, "E5": 365, "E6": 845}
"""RUL(t_fs), minutes (Table 20)."""
TABLE_22 = {
    "E1": (3.42, 6.53, 1.35),
    "E2": (6.22, 1.28, 1.68),
    "E3": (1.49, 0.25, 3.48),
    "E4": (3.41, 2.99, 1.18),
    "E5": (6.62, 2.24, 0.63),
    "E6": (0.55, 3.05, 1.14),
}
"""a x 1e-7, b x 1e-5 and c x 1e-3, mm3/mm and minutes."""
TABLE_21 = {"E1": (3.4, 5.2, 5.5), "E2": (3.2, 4.8, 5.1), "E3": (2.8, 4.1, 4.4), "experimental": (3.7, 4.8, 6.6)}
"""RMS at the end at 3000, 4700 and 5000 N, g."""
STEP = 5.0 * MINUTE
NOISE = 0.5
"""RMS of the sensor's noise within 0 to 25.6 kHz, m/s2."""
HEALTHY = 24
"""Blocks that are simulated before the final stage, evenly over it."""
_RATE = 51200.0
_SECONDS = 0.4
_MAP_FLOORS, _TWIN_FLOOR = 2, 100
_LARGEST = (math.radians(50.0), 32e-6)


def printed_law(test: str) -> QuadraticFit:
    """Return the printed quadratic of a test in SI units."""
    a, b, c = TABLE_22[test]
    return QuadraticFit(0.0, a * 1e-7 * MM2 / MINUTE**2, b * 1e-5 * MM2 / MINUTE, c * 1e-3 * MM2, 1.0)


def true_volume(test: str, t: float) -> float:
    """Return the true volume of a twin, m2, at a time from t_fs, s."""
    law, end = printed_law(test), LENGTHS[test] * MINUTE
    crossing = law.first_crossing(V_TH)
    if crossing is None or t <= crossing:
        return law.value_at(t)
    slope = 2.0 * law.a * crossing + law.b
    share = (t - crossing) / (end - crossing)
    return V_TH + slope * (t - crossing) + (V_END - V_TH - slope * (end - crossing)) * share**3


@lru_cache(maxsize=1)
def maps() -> RmsMap:
    """Return the maps of Fig. 61: four loads at 40 Hz, rough floors."""
    plan = MapPlan(
        load=(3000.0, 4000.0, 4700.0, 5000.0),
        speed=(SPEED,),
        h_d=tuple(np.linspace(0.0, _LARGEST[1], 33).tolist()),
        dphi_d=tuple(np.linspace(0.0, _LARGEST[0], 201).tolist()),
        floor=Floor("rough"),
        floors=_MAP_FLOORS,
        rms_band=BAND,
    )
    return build_map(plan)


def sizes(v_eq: float) -> tuple[float, float]:
    """Return extent (rad) and depth (m) of a twin's defect of a volume (m2): both in proportion."""
    bearing = from_catalogue("1205 ETN9")
    share = math.sqrt(v_eq / (race_radius(bearing) * _LARGEST[0] * _LARGEST[1]))
    return share * _LARGEST[0], share * _LARGEST[1]


def scene(test: str, v_eq: float) -> Scene:
    """Return the scene of a test with a damage of a volume, healthy where it is zero."""
    if v_eq == 0.0:
        return Scene(SPEED, LOADS[test])
    extent, depth = sizes(v_eq)
    return Scene(SPEED, LOADS[test], defect=Defect(extent, depth, Floor("rough", seed=_TWIN_FLOOR)))


def with_noise(rms: Values | float) -> Any:
    """Return the RMS in the band of a signal together with the sensor's noise, m/s2."""
    return np.sqrt(np.square(rms) + NOISE**2 * BAND[1] / (0.5 * _RATE))


@dataclass(frozen=True, eq=False)
class Twin:
    """The final stage of one simulated life and what the trackers of the thesis make of it.

    Attributes:
        test: its name.
        t: time from t_fs, s.
        v_true: the true volume, m2.
        rms: what the sensor gives, m/s2.
        smoothed: its moving mean, m/s2.
        dphi_d: tracked extent, rad; NaN where there is none.
        h_d: tracked depth, m.
        v_eq: tracked volume, m2.
    """

    test: str
    t: Values
    v_true: Values
    rms: Values
    smoothed: Values
    dphi_d: Values
    h_d: Values
    v_eq: Values

    @property
    def below(self) -> tuple[Values, Values]:
        """Times (s) and tracked volumes (m2) up to the threshold, its crossing interpolated (section 5.4.3)."""
        known = np.isfinite(self.v_eq)
        t, v = self.t[known], self.v_eq[known]
        over = np.flatnonzero(v >= V_TH)
        if not over.size or over[0] == 0:
            return t, v
        k = int(over[0])
        cross = t[k - 1] + (V_TH - v[k - 1]) / (v[k] - v[k - 1]) * (t[k] - t[k - 1])
        return np.append(t[:k], cross), np.append(v[:k], V_TH)

    @property
    def fit(self) -> QuadraticFit | None:
        """The quadratic through the first point and the others up to the threshold."""
        return fit_quadratic(*self.below)

    def forecasts(self, threshold: float) -> list[Remaining]:
        """Return what the second model of the thesis says after every block."""
        state, found = ForecastState(), []
        for t, v in zip(self.t, self.v_eq, strict=True):
            state, (result,) = forecast(state, float(t), float(v), thresholds=[threshold])
            found.append(result)
        return found


@lru_cache(maxsize=1)
def twins() -> dict[str, Twin]:
    """Return the six simulated final stages, tracked."""
    return {test: _twin(test) for test in TESTS}


def _twin(test: str) -> Twin:
    t = np.arange(0.0, LENGTHS[test] * MINUTE + 1.0, STEP)
    v_true = np.array([true_volume(test, float(moment)) for moment in t])
    rms = with_noise(np.array([simulate(scene(test, float(v)), band=BAND).rms for v in v_true]))
    surface = to_slice(maps(), LOADS[test], SPEED)
    state, rows = EdvState(), []
    for value in rms:
        state, found = track(state, float(value), map_slice=surface, settings=EdvSettings())
        usable = found.status in (EdvStatus.OK, EdvStatus.WIDENED)
        rows.append(
            (found.rms_smoothed, *((found.dphi_d, found.h_d, found.v_eq) if usable else (math.nan, math.nan, math.nan)))
        )
    smoothed, dphi_d, h_d, v_eq = np.array(rows).T
    return Twin(test, t, v_true, rms, smoothed, dphi_d, h_d, v_eq)


def block(test: str, v_eq: float, seed: int) -> BlockFeatures:
    """Return the features of one recorded block: the simulated signal with noise, as the pipeline takes them."""
    response = simulate(scene(test, v_eq))
    signal = response.acceleration(_RATE, _SECONDS, phase=float(seed))
    signal = signal + np.random.default_rng(seed).normal(0.0, NOISE, signal.size)
    lines = fundamentals(kinematics(from_catalogue("1205 ETN9"), SPEED))
    return block_features(signal, _RATE, FeatureSettings(_RATE, (ENVELOPE_BAND,), lines, rms_band=(1.0, BAND[1])))


@lru_cache(maxsize=1)
def histories() -> dict[str, tuple[Values, Values, Values]]:
    """Return time (s), RMS (m/s2) and H_or (m/s2) over the whole of each life: some blocks of it."""
    found = {}
    for number, test in enumerate(TESTS):
        # The last one just before the onset, so that no line slopes towards it.
        healthy = np.linspace(0.0, ONSETS[test] * MINUTE - STEP, HEALTHY)
        final = np.arange(0.0, LENGTHS[test] * MINUTE + 1.0, 5 * STEP)
        volumes = [*(0.0 for _ in healthy), *(true_volume(test, float(t)) for t in final)]
        blocks = [block(test, v, 1000 * number + k) for k, v in enumerate(volumes)]
        time = np.concatenate((healthy, ONSETS[test] * MINUTE + final))
        found[test] = time, np.array([b.rms for b in blocks]), np.array([b.values["h_or"] for b in blocks])
    return found
