"""A simulated rig with a bearing that wears out, and its true damage.

Each block is simulated by the six-degree-of-freedom model at its own extent and depth of the defect, on a rough floor
and with rig parameters a few per cent off the nominal ones: no map describes the bearing exactly.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any
from urllib.parse import parse_qsl

import numpy as np
from numpy.typing import NDArray

from models.bearing import Bearing, from_catalogue
from models.response import Response
from models.rigs.six_dof import Rig
from models.scene import Defect, Floor, Scene
from streams.block import STANDARD_GRAVITY, Block
from streams.spec import SourceError

CHANNELS = ("test_bearing", "support_drive", "support_free")
RATE = 25600.0
BLOCK_SECONDS = 5.0
INTERVAL = 300.0
"""Seconds from block to block (thesis, section 2.3.2: 5 s of signal every 5 minutes)."""

_SPREAD = (0.02, 0.05)
"""Smallest and largest relative deviation of a rig parameter from its nominal value."""
_THRESHOLD = 0.05e-6
"""V_eq to which the growth laws are scaled, m2 (thesis, section 5.4.3)."""
_PATH = (1.0, 0.03, 0.02)
"""Share of the test bearing's vibration that reaches each sensor."""


@dataclass(frozen=True)
class Life:
    """Growth of the damage after the onset, in m2 and s (thesis, Table 22).

    V = V_0 + b t + a t^2.

    Attributes:
        onset: number of the first block with damage.
        h_threshold: depth where V reaches 0.05 mm3/mm, m.
        depth_share: share of ln V that ln h_d takes, the rest is extent.
    """

    onset: int
    v_0: float
    a: float
    b: float
    h_threshold: float
    depth_share: float

    def v_eq(self, t: float) -> float:
        """Return the volume per width at ``t`` seconds after the onset, m2; 0 before it."""
        return 0.0 if t < 0.0 else self.v_0 + self.b * t + self.a * t * t

    def time_to(self, v: float) -> float:
        """Return the time from onset to a volume ``v``, s (Table 22: the root ahead)."""
        missing = max(v - self.v_0, 0.0)
        return 2.0 * missing / (self.b + math.sqrt(self.b * self.b + 4.0 * self.a * missing))

    def defect(self, t: float, outer_race_radius: float, floor: Floor) -> Defect | None:
        """Return the defect at ``t`` seconds after the onset, or None before it."""
        v = self.v_eq(t)
        if v <= 0.0:
            return None
        h_d = self.h_threshold * (v / _THRESHOLD) ** self.depth_share
        return Defect(dphi_d=v / (outer_race_radius * h_d), h_d=h_d, floor=floor)


def draw_life(rng: np.random.Generator, onset: int) -> Life:
    """Draw a life in the range of Table 22: 257 to 705 minutes to the threshold."""
    duration = rng.uniform(257.0, 705.0) * 60.0
    v_0 = rng.uniform(0.0012, 0.0035) * 1e-6
    # Share of the quadratic term in the growth to the threshold; in Table 22 it is 0.56 to 0.98.
    curved = rng.uniform(0.56, 0.98)
    growth = _THRESHOLD - v_0
    return Life(
        onset=onset,
        v_0=v_0,
        a=curved * growth / duration**2,
        b=(1.0 - curved) * growth / duration,
        h_threshold=rng.uniform(6e-6, 16e-6),
        depth_share=rng.uniform(0.3, 0.6),
    )


def perturbed(rig: Rig, rng: np.random.Generator) -> Rig:
    """Return the rig with each parameter 2 to 5 % off, up or down."""
    names = ("m_i", "m_o", "m_r", "k_i", "k_r", "k_c", "c_i", "c_r", "alpha_c", "beta_c")
    factors = 1.0 + rng.choice([-1.0, 1.0], len(names)) * rng.uniform(*_SPREAD, len(names))
    return replace(rig, **{name: getattr(rig, name) * float(f) for name, f in zip(names, factors, strict=True)})


class SimulatedRig:
    """The bench of the thesis with a bearing that wears out, with ground truth.

    The same name and seed give the same blocks bit for bit. Times count from the first block; there is no date.
    """

    def __init__(
        self,
        name: str,
        seed: int,
        *,
        healthy_blocks: int = 150,
        blocks: int | None = None,
        load: float = 4000.0,
        speed: float = 40.0,
        nominal: Rig | None = None,
    ) -> None:
        """Draw the life of a bearing; load in N, shaft speed in Hz.

        ``healthy_blocks`` come before the damage, ``blocks`` in all; None: until V_eq is 1.3 times the threshold. The
        true rig parameters deviate from the ``nominal`` ones.
        """
        rng = np.random.default_rng([seed, 1])
        self.name = name
        self.seed = seed
        self.load, self.speed = load, speed
        self.bearing: Bearing = from_catalogue("1205 ETN9")
        self.rig = perturbed(nominal or Rig(), rng)
        self.floor = Floor(kind="rough", sd=float(rng.uniform(0.4e-6, 0.9e-6)), seed=int(rng.integers(1, 2**31)))
        self.life = draw_life(rng, healthy_blocks + 1)
        worn = healthy_blocks + math.ceil(self.life.time_to(1.3 * _THRESHOLD) / INTERVAL) + 1
        self._blocks = worn if blocks is None else blocks

    def __len__(self) -> int:
        """Return how many blocks there are."""
        return self._blocks

    def __iter__(self) -> Iterator[Block]:
        """Simulate the blocks in order."""
        for sequence in range(1, self._blocks + 1):
            yield self.block(sequence)

    def time_after_onset(self, sequence: int) -> float:
        """Return the seconds from the onset of the damage to a block, negative before it."""
        return (sequence - self.life.onset) * INTERVAL

    def truth(self, sequence: int, thresholds: tuple[float, ...]) -> dict[str, Any]:
        """Return ``v_eq_true`` (m2) and ``tt_true`` (s, one a threshold) of a block."""
        t = self.time_after_onset(sequence)
        times = (max(0.0, self.life.time_to(v) - t) for v in thresholds)
        return {"v_eq_true": self.life.v_eq(t), "tt_true": tuple(times) if t >= 0.0 else (None,) * len(thresholds)}

    def scene(self, sequence: int, speed: float, load: float) -> Scene:
        """Return the scene of a block."""
        radius = self.bearing.outer_race_radius
        if radius is None:
            raise SourceError(f"rig {self.name!r}: the outer race radius of {self.bearing.designation} is unknown")
        defect = self.life.defect(self.time_after_onset(sequence), radius, self.floor)
        return Scene(speed=speed, load=load, bearing=self.bearing, rig=self.rig, defect=defect)

    def block(self, sequence: int) -> Block:
        """Simulate one block; it depends on the seed and its number only."""
        rng = np.random.default_rng([self.seed, 2, sequence])
        # The drive holds the speed within 0.2 % and the lever the load within 1 %; damage is simulated at both.
        speed = self.speed * (1.0 + 0.001 * float(rng.standard_normal()))
        damaged = sequence >= self.life.onset
        load = self.load * (1.0 + 0.005 * float(rng.standard_normal()))
        response = self._simulate(self.scene(sequence, speed, load)) if damaged else self._healthy
        casing = response.acceleration(RATE, BLOCK_SECONDS, phase=float(rng.uniform(0.0, 2.0 * np.pi)))
        level = 1.0 + 0.6 * math.exp(-sequence / 8.0) + 0.02 * math.sin(2.0 * math.pi * sequence / 97.0)
        samples = np.empty((len(CHANNELS), casing.size), dtype=np.float32)
        for row in range(len(CHANNELS)):
            samples[row] = _PATH[row] * casing + level * self._background(rng, casing.size, speed)
        return Block(
            samples=samples,
            rate=RATE,
            channels=CHANNELS,
            units=("m/s2",) * len(CHANNELS),
            source=self.name,
            sequence=sequence,
            name=f"rig[{sequence}]",
            elapsed=(sequence - 1) * INTERVAL,
            content_hash=f"rig-{self.seed}-{sequence}",
        )

    @cached_property
    def _healthy(self) -> Response:
        return self._simulate(self.scene(0, self.speed, self.load))

    @staticmethod
    def _simulate(scene: Scene) -> Response:
        # Imported here, so that a rig that is only configured does not load the compiled kernels.
        from models.simulate import simulate

        return simulate(scene)

    @staticmethod
    def _background(rng: np.random.Generator, n: int, speed: float) -> NDArray[np.float32]:
        """Return shaft harmonics and broadband noise of 50 mg, m/s2."""
        noise = rng.standard_normal(n, dtype=np.float32) * np.float32(0.05 * STANDARD_GRAVITY)
        t = np.arange(n) / RATE
        for order, amplitude in ((1, 0.02), (2, 0.03), (3, 0.01)):
            phase = float(rng.uniform(0.0, 2.0 * np.pi))
            tone = amplitude * STANDARD_GRAVITY * np.cos(2.0 * np.pi * order * speed * t + phase)
            noise += tone.astype(np.float32)
        return noise


_OPTIONS = {"seed": int, "healthy_blocks": int, "blocks": int, "load_newton": float, "speed_hz": float}


def open_rig(url: str, name: str) -> SimulatedRig:
    """Open ``rig:NAME?seed=N``; SourceError names an unknown rig or option, or a wrong value."""
    place, _, query = url.removeprefix("rig:").partition("?")
    where = f"[[source]] {name}: url {url!r}"
    if place != "ferrara":
        raise SourceError(f"{where}: unknown rig {place!r}; known are: ferrara")
    options: dict[str, Any] = {}
    for key, value in parse_qsl(query, keep_blank_values=True):
        if key not in _OPTIONS:
            raise SourceError(f"{where}: unknown option {key!r}; known are: {', '.join(_OPTIONS)}")
        try:
            options[key] = _OPTIONS[key](value)
        except ValueError:
            raise SourceError(f"{where}: {key}={value!r} is not a number") from None
        if key != "seed" and not options[key] > 0:
            raise SourceError(f"{where}: {key} must be positive, got {value}")
    renamed = {"load_newton": "load", "speed_hz": "speed"}
    return SimulatedRig(name, options.pop("seed", 0), **{renamed.get(key, key): options[key] for key in options})
