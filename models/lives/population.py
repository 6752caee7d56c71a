"""Settings of a population of simulated lives (models.lives.life): plain data with a JSON form and a hash."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass, field
from typing import Any

from models.lives.laws import LAWS, WEIGHTS
from models.machine.bearing import Bearing, from_catalogue
from models.machine.rig import Rig, RigDraws, RigParameters, without_draws
from models.maps.plan import check_depth, version_of
from models.solve.registry import RIGS

Range = tuple[float, float]

# Increment when the same population would give other lives.
LIVES_VERSION = 3
_GRAVITY = 9.80665
_RIG_SPREAD = (*((name, 0.035) for name in ("m_r", "k_c", "c_i", "c_r", "alpha_c", "beta_c")), ("k_r", 0.014))
_RANGES = (
    "load",
    "speed",
    "durations",
    "v_0",
    "h_threshold",
    "depth_share",
    "floor_sd",
    "slip",
    "background_rms",
    "background_harmonic",
    "scatter",
    "line_scatter",
)
# Ranges that may be (0, 0).
_MAY_BE_NONE = ("slip", "floor_sd", "scatter", "line_scatter")
_SHARES = (
    "gain_sd",
    "harmonic_gain_sd",
    "roughness",
    "gain_drift",
    "load_steps",
    "load_error",
    "speed_error",
    "load_jitter",
    "speed_jitter",
    "load_variation",
    "speed_variation",
)


@dataclass(frozen=True)
class Population:
    """Settings of a population of lives, SI units and radians; equal settings give equal lives.

    Ranges are (lo, hi) of uniform draws, in the logarithm where stated. Standard deviations of factors are those of
    their logarithm.

    Attributes:
        rig: parameters of the machine; they name the model. Lives of another than the six-degree-of-freedom one have
            smooth floors and no slip.
        rig_spread: (parameter, standard deviation of its factor) of each rig parameter that differs from life to life.
        rig_posterior: rigs of the lives, from the posterior of the identification of ``rig``, in place of
            ``rig_spread``; None for none.
        clearance: radial clearance, m.
        load, speed: ranges of radial loads, N, and shaft speeds, Hz; one of each per life.
        load_steps: mean number of known steps of the load within a life, each to another load of the range.
        load_variation, speed_variation: known change from block to block: each has a factor of 1 +- this.
        load_error, speed_error: standard deviation of a factor on the load and on the speed, one per life, unknown to
            the monitor.
        load_jitter: standard deviation of the factor on the load of a block, unknown to the monitor.
        speed_jitter: the same of the speed. (A few tenths of a per cent move the RMS by some per cent.) Blocks of
            lives with slip are simulated side by side in groups of nearly the same speed, at the mean of each group.
        laws: (growth law, weight) pairs; see ``models.lives.laws``.
        durations: range of nominal lives, s, drawn in the logarithm; the 95 % prediction interval of a further life
            after the six of Table 22 of the thesis is 1.9 to 20 h.
        threshold: V_eq at the end of a nominal life, m2.
        until: largest V_eq of interest, m2; blocks continue for 1.35 times the time to reach it.
        v_0: range of V_eq at the onset, m2, drawn in the logarithm; Table 22 of the thesis has 0.63 to 3.5e-9 m2.
        roughness: standard deviation of the factor on the growth within five minutes.
        h_threshold: range of the depth where V_eq is ``threshold``, m, drawn in the logarithm.
        depth_share: range of the share of ln V_eq that ln h_d takes; the rest is extent.
        floor_sd: range of the standard deviation of the rough floor, m.
        slip: range of the largest slip angle of the balls, rad (a uniform angle for each passage); (0, 0) is none.
        rms_band: band in which RMS is taken, Hz, or None for the full bandwidth.
        gain_sd: standard deviation of the gain of the sensor, one per life.
        gain_drift: standard deviation of a further factor at the end of the life: a random walk from the onset.
        harmonic_gain_sd: standard deviation of a further factor on each harmonic, constant over a life.
        scatter, line_scatter: ranges of the standard deviation of the factor on the RMS, and on each harmonic, of each
            block, drawn in the logarithm, one per life.
        background_rms, background_harmonic: ranges of the RMS of background vibration and of its amplitude at each
            harmonic, m/s2, drawn in the logarithm, one per life; they add as power.
        missing: probability that a block is lost.
        interval: time from block to block, s.
    """

    bearing: Bearing = field(default_factory=lambda: from_catalogue("1205 ETN9"))
    rig: RigParameters = field(default_factory=Rig)
    rig_spread: tuple[tuple[str, float], ...] = _RIG_SPREAD
    rig_posterior: RigDraws | None = None
    clearance: float = 0.0
    load: Range = (3000.0, 5000.0)
    speed: Range = (20.0, 45.0)
    load_variation: float = 0.0
    speed_variation: float = 0.0
    load_error: float = 0.02
    speed_error: float = 0.003
    load_jitter: float = 0.005
    speed_jitter: float = 0.004
    load_steps: float = 0.3
    laws: tuple[tuple[str, float], ...] = tuple(WEIGHTS.items())
    durations: Range = (120.0 * 60.0, 1200.0 * 60.0)
    threshold: float = 0.05e-6
    until: float = 0.05e-6
    v_0: Range = (0.0004e-6, 0.006e-6)
    roughness: float = 0.5
    h_threshold: Range = (4e-6, 20e-6)
    depth_share: Range = (0.2, 0.7)
    floor_sd: Range = (0.3e-6, 1.6e-6)
    slip: Range = (0.0, 0.0)
    rms_band: Range | None = (0.0, 9500.0)
    gain_sd: float = 0.12
    gain_drift: float = 0.06
    harmonic_gain_sd: float = 0.15
    scatter: Range = (0.01, 0.08)
    line_scatter: Range = (0.02, 0.2)
    background_rms: Range = (0.02 * _GRAVITY, 0.1 * _GRAVITY)
    background_harmonic: Range = (0.001 * _GRAVITY, 0.03 * _GRAVITY)
    missing: float = 0.03
    interval: float = 300.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value, the value and the expected one."""
        for name in _RANGES:
            low, high = getattr(self, name)
            if not (math.isfinite(high) and low <= high and (low > 0.0 or (name in _MAY_BE_NONE and low == 0.0))):
                raise ValueError(f"population {name} needs a finite range 0 < lo <= hi, got {(low, high)!r}")
        for name in _SHARES:
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"population {name} must be finite and not negative, got {value!r}")
        if not self.v_0[1] < self.threshold <= self.until < math.inf:
            raise ValueError(
                f"population needs v_0 < threshold <= until, got {self.v_0!r}, {self.threshold!r} and {self.until!r}"
            )
        if not self.laws or any(law not in LAWS or not weight > 0.0 for law, weight in self.laws):
            raise ValueError(f"population laws need names of {', '.join(LAWS)} and weights above 0, got {self.laws!r}")
        named = {name for name, _ in self.rig_spread}
        unknown = named - set(vars(self.rig)) | named & {"calibrated", "identification"}
        if unknown:
            raise ValueError(f"population rig_spread names {', '.join(sorted(unknown))}, which is no rig parameter")
        self._check_model()
        if not (0.0 <= self.missing < 1.0 and self.interval > 0.0 and self.depth_share[1] <= 1.0):
            raise ValueError(
                "population needs 0 <= missing < 1, interval > 0 and depth_share <= 1, got "
                f"{self.missing!r}, {self.interval!r} and {self.depth_share!r}"
            )
        if self.slip[1] > 0.0 and self.speed_variation > 0.0:
            raise ValueError("population: lives with slip have one speed each, speed_variation must be 0")

    def _check_model(self) -> None:
        check_depth(self.rig.model)
        if isinstance(self.rig, Rig):
            if self.rig_posterior is not None:
                self.rig_posterior.check(self.rig)
        elif self.rig_posterior is not None or self.slip[1] > 0.0:
            what = "rig_posterior" if self.rig_posterior is not None else "slip"
            raise ValueError(f"population {what} is one of {Rig.model}, the rig is that of {self.rig.model}")

    @property
    def rig_spread_words(self) -> str:
        """What the rigs of the lives differ by, as text."""
        if self.rig_posterior is not None:
            return f"spread over the posterior of identification {self.rig_posterior.identification}"
        assumed = ", ".join(f"{name} +-{100.0 * sd:g} %" for name, sd in self.rig_spread)
        return f"assumed spread of {assumed}" if assumed else "none: all lives have one rig"

    def as_json(self) -> str:
        """Return the population as canonical JSON; ``from_json`` reads it back exactly."""
        values = without_draws(asdict(self), self.rig_posterior) | {"rig": self.rig.as_dict()}
        if self.rig.model != Rig.model:
            # Not named before there were other models, so that libraries keep their hash.
            values["model"] = self.rig.model
        return json.dumps(values, sort_keys=True)

    @classmethod
    def from_json(cls, text: str) -> Population:
        """Return the population that ``as_json`` wrote.

        Raises:
            ValueError: if the text is not a population.
        """
        try:
            data: dict[str, Any] = json.loads(text)
            kind = RIGS[data.pop("model", Rig.model)]
            data |= {"bearing": Bearing(**data["bearing"]), "rig": kind(**data["rig"])}
            # Populations of version 1 had neither drift nor steps, those of version 2 one scatter of all figures.
            data = {"gain_drift": 0.0, "load_steps": 0.0, "load_error": 0.0, "speed_error": 0.0} | data
            if isinstance(data["scatter"], float):
                data |= dict.fromkeys(("scatter", "line_scatter"), (data["scatter"], data["scatter"]))
            data["rig_posterior"] = RigDraws.from_dict(data.get("rig_posterior"))
            for name in _RANGES:
                data[name] = tuple(data[name])
            for name in ("laws", "rig_spread"):
                data[name] = tuple((key, value) for key, value in data[name])
            data["rms_band"] = None if data["rms_band"] is None else tuple(data["rms_band"])
            return cls(**data)
        except (TypeError, KeyError, json.JSONDecodeError) as error:
            raise ValueError(f"the parameters of the population are not those of this version: {error}") from error

    def hash(self) -> str:
        """Return a hash of the population, the model and the drawing: equal hashes, equal lives."""
        return hashlib.sha256(f"{version_of(self.rig.model)} {LIVES_VERSION} {self.as_json()}".encode()).hexdigest()
