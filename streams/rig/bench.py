"""A simulated rig with a bearing that wears out, and its true damage.

Each block is simulated at its own extent and depth of the defect, with rig parameters a few per cent off the nominal
ones and, where the model has one, on a rough floor: no map describes the bearing exactly.
"""

from __future__ import annotations

import hashlib
import math
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property
from typing import Any, Protocol
from urllib.parse import parse_qsl

import numpy as np
from numpy.typing import NDArray

from models.machine.rig import RigParameters
from models.machine.scene import EFFECTS, Floor, Scene
from models.machine.shaft_marks import time_of_turns
from models.machine.speed_profile import SpeedProfile, constant
from models.path.defect import race_radius
from models.solve.angular.rig import AngularRig
from models.solve.response import Response, row_of
from models.words.extras import load
from models.words.request import SENSORS, Sensor
from streams.rig.machine import THRESHOLD, RigMachine, draw_life, machine_of, perturbed
from streams.rig.running import TACHO_CHANNEL, Running, running_of
from streams.types.block import STANDARD_GRAVITY, Block
from streams.types.spec import SourceError

CHANNELS = ("test_bearing", "support_drive", "support_free")
RATE = 25600.0
BLOCK_SECONDS = 5.0
_SAMPLES = round(RATE * BLOCK_SECONDS)
_ACCURACY = 0.02
"""Of the RMS of a motion over time, whose steps are halved until their error is smaller."""
INTERVAL = 300.0
"""Seconds from block to block (thesis, section 2.3.2: 5 s of signal every 5 minutes)."""

_AHEAD = 4
"""Blocks that are simulated while another one is analysed."""
_PATH = (1.0, 0.03, 0.02)
"""Share of the test bearing's vibration that reaches each sensor."""
_PATH_OF_GEARS = np.array([1.0, 0.7, 0.7], dtype=np.float32)
"""The same of the gears."""
_BACKGROUND = 0.05 * STANDARD_GRAVITY
"""RMS of the broadband noise, m/s2."""
_TRIED_SECONDS = 0.05
"""Time over which a model is tried on the worst damage."""
_REPEATED_SECONDS = 0.5
"""Time over which the lines of a motion are found that repeats."""
_GEARS: Any = load("rig", "gears")
"""Gears that run beside the bearing: options of a URL, and what the sensors show of them."""


class SamplesBeside(Protocol):
    """What runs beside the bearing; its repr tells the blocks of one from those of another."""

    @property
    def words(self) -> str:
        """What it is, for people."""
        ...

    def in_block(self, sequence: int) -> SamplesBeside:
        """Return it as it is in a block, from 1."""
        ...


class SimulatedRig:
    """A bench with a bearing that wears out, with ground truth; by default that of the thesis.

    The same name, seed and machine give the same blocks bit for bit. Times count from the first block; there is no
    date.
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
        machine: RigMachine | None = None,
        running: Running | None = None,
        gears: SamplesBeside | None = None,
    ) -> None:
        """Draw the life of a bearing; load in N, shaft speed in Hz.

        ``healthy_blocks`` come before the damage, ``blocks`` in all; None: until V_eq is 1.3 times the threshold. The
        true parameters deviate from the nominal ones of the machine. ``running`` says how the shaft turns, by default
        steadily; its speed counts. ``gears`` run beside the bearing.

        Raises:
            ValueError: the model does not describe how the shaft turns.
        """
        rng = np.random.default_rng([seed, 1])
        self.name = name
        self.seed = seed
        self.running = Running(speed=speed) if running is None else running
        self.load, self.speed = load, self.running.speed
        self.machine = machine_of() if machine is None else machine
        self.gears = gears
        self._check_running()
        self.bearing = self.machine.bearing
        self.rig: RigParameters = perturbed(self.machine.nominal, rng)
        self._rough = Floor(kind="rough", sd=float(rng.uniform(0.4e-6, 0.9e-6)), seed=int(rng.integers(1, 2**31)))
        self.life = draw_life(rng, healthy_blocks + 1)
        worn = healthy_blocks + math.ceil(self.life.time_to(1.3 * THRESHOLD) / INTERVAL) + 1
        self._blocks = worn if blocks is None else blocks

    def _check_running(self) -> None:
        wanted = {"changing_speed": self.running.varies, "slip": self.running.slip > 0.0}
        wanted[f"{self.running.fault}_defect"] = True
        for effect, asked in wanted.items():
            if asked and effect not in self.machine.effects:
                raise ValueError(f"{self.machine.model} does not describe {EFFECTS[effect]}")

    @cached_property
    def floor(self) -> Floor:
        """The floor of the defect: rough where the model describes that."""
        return self._rough if "rough_floor" in self.machine.effects else Floor()

    @cached_property
    def sensor(self) -> Sensor:
        """The sensor of the model that the accelerometer shows.

        Raises:
            ValueError: the model does not describe the worst damage of the life, or has no such sensor of acceleration.
        """
        worst = self._simulate(self.scene(self._blocks, self.speed, self.load), duration=_TRIED_SECONDS)
        shown: tuple[Sensor, ...] = tuple(sensor for sensor in worst.sensors if sensor != "ias")
        return shown[row_of(shown, self.machine.sensor)]

    @property
    def limits(self) -> tuple[str, ...]:
        """What differs from the bench of the thesis, in sentences; raises as ``sensor``."""
        gears = () if self.gears is None else (self.gears.words,)
        return gears if self.machine.is_bench else (*self.machine.limits(self.sensor), *gears)

    def __len__(self) -> int:
        """Return how many blocks there are."""
        return self._blocks

    def __iter__(self) -> Iterator[Block]:
        """Simulate the blocks in order, some ahead of the one that is taken: the kernels run beside the interpreter."""
        with ThreadPoolExecutor(2, "rig") as simulator:
            ahead = deque[Future[Block]]()
            try:
                for sequence in range(1, self._blocks + 1):
                    ahead.append(simulator.submit(self.block, sequence))
                    if len(ahead) > _AHEAD:
                        yield ahead.popleft().result()
                while ahead:
                    yield ahead.popleft().result()
            finally:
                simulator.shutdown(cancel_futures=True)

    def time_after_onset(self, sequence: int) -> float:
        """Return the seconds from the onset of the damage to a block, negative before it."""
        return (sequence - self.life.onset) * INTERVAL

    def truth(self, sequence: int, thresholds: tuple[float, ...]) -> dict[str, Any]:
        """Return ``v_eq_true`` (m2) and ``tt_true`` (s, one a threshold) of a block, and where the speed varies
        ``speed_true`` and ``speed_range_true`` (mean, and least and highest speed, Hz).
        """
        t = self.time_after_onset(sequence)
        times = (max(0.0, self.life.time_to(v) - t) for v in thresholds)
        found = {"v_eq_true": self.life.v_eq(t), "tt_true": tuple(times) if t >= 0.0 else (None,) * len(thresholds)}
        if not self.running.varies:
            return found
        turning = self.rotation(sequence)
        return found | {"speed_true": turning.mean_speed, "speed_range_true": turning.speed_range}

    def rotation(self, sequence: int) -> SpeedProfile:
        """Return how the shaft turns in a block, or how its drive does where the model has an angular speed."""
        if self.running.varies:
            return self.running.profile(self.seed, sequence, BLOCK_SECONDS)
        return constant(self._held_speed(np.random.default_rng([self.seed, 2, sequence])), BLOCK_SECONDS)

    def _held_speed(self, rng: np.random.Generator) -> float:
        # The drive holds the speed within 0.2 %.
        return self.speed * (1.0 + 0.001 * float(rng.standard_normal()))

    def scene(self, sequence: int, speed: float, load: float) -> Scene:
        """Return the scene of a block."""
        radius = race_radius(self.bearing)
        defect = self.life.defect(self.time_after_onset(sequence), radius, self.floor)
        return Scene(
            speed=speed,
            load=load,
            bearing=self.bearing,
            rig=self.rig,
            defect=None if defect is None else replace(defect, part=self.running.fault),
            model=self.machine.model,
            slip=self.running.slip_of(sequence),
        )

    def block(self, sequence: int) -> Block:
        """Simulate one block; it depends on machine, seed and its number only."""
        return self.with_turns(sequence)[0]

    def with_turns(self, sequence: int) -> tuple[Block, NDArray[np.float64]]:
        """Return a block and how far its shaft has turned at each sample, revolutions since the first."""
        rng = np.random.default_rng([self.seed, 2, sequence])
        speed = self._held_speed(rng)
        # The lever holds the load within 1 %; damage is simulated at the block's own speed and load.
        load = self.load * (1.0 + 0.005 * float(rng.standard_normal()))
        time: NDArray[np.float64] = np.arange(_SAMPLES, dtype=np.float64) / RATE
        if self.running.varies:
            casing, turns = self._varying(sequence, load)
            time = turns / speed
        else:
            damaged = sequence >= self.life.onset
            response = self._simulate(self.scene(sequence, speed, load)) if damaged else self._healthy
            casing, turns = self._sampled(response, float(rng.uniform(0.0, 2.0 * np.pi))), speed * time
        level = 1.0 + 0.6 * math.exp(-sequence / 8.0) + 0.02 * math.sin(2.0 * math.pi * sequence / 97.0)
        samples = np.empty((len(self.channels), casing.size), dtype=np.float32)
        for row in range(len(CHANNELS)):
            samples[row] = self.machine.gain * _PATH[row] * casing + level * self._background(rng, speed, time)
        if self.gears is not None:
            samples[: len(CHANNELS)] += np.multiply.outer(_PATH_OF_GEARS, self._gear(sequence, turns))
        if self.running.marks is not None:
            samples[-1] = self._tacho(sequence, turns)
        return self._block(sequence, samples), turns

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels."""
        return CHANNELS if self.running.marks is None else (*CHANNELS, TACHO_CHANNEL)

    def _block(self, sequence: int, samples: NDArray[np.float32]) -> Block:
        marks = self.running.marks
        return Block(
            samples=samples,
            rate=RATE,
            channels=self.channels,
            units=("m/s2",) * len(CHANNELS) + ("V",) * (len(self.channels) - len(CHANNELS)),
            source=self.name,
            sequence=sequence,
            name=f"rig[{sequence}]",
            elapsed=(sequence - 1) * INTERVAL,
            pulses_per_revolution=None if marks is None else marks.per_turn,
            content_hash=f"rig-{self._hashed}{self.seed}-{sequence}",
        )

    def _varying(self, sequence: int, load: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return acceleration, m/s2, and revolutions at the samples of a block whose speed changes."""
        from models.solve.simulate import simulate

        profile = self.rotation(sequence)
        scene = replace(self.scene(sequence, profile.mean_speed, load), speed_profile=profile)
        response = simulate(scene, duration=BLOCK_SECONDS, rate=RATE, accuracy=_ACCURACY)
        return response.acceleration(RATE, BLOCK_SECONDS, sensor=self.sensor), response.turns()

    def _tacho(self, sequence: int, turns: NDArray[np.float64]) -> NDArray[np.float32]:
        profile = self.rotation(sequence)
        time_at = time_of_turns(turns, RATE) if self.machine.model == AngularRig.model else profile.time_at
        return self.running.tacho(time_at, profile, sequence, turns.size, RATE)

    def _gear(self, sequence: int, turns: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return the acceleration of the gears at the shaft's turns, m/s2, in a block that begins anywhere."""
        assert self.gears is not None
        heard = _GEARS.gear_sound(
            self.gears.in_block(sequence), self.speed, self.running.fastest, self.seed, RATE, _BACKGROUND
        )
        begin = np.random.default_rng([self.seed, 6, sequence]).uniform(0.0, heard.turns)
        return heard.at(turns + begin, RATE).astype(np.float32)

    @cached_property
    def _healthy(self) -> Response:
        return self._simulate(self.scene(0, self.speed, self.load))

    @property
    def _hashed(self) -> str:
        """What tells the blocks of other machines from those of the bench of the thesis."""
        machine = self.machine
        named = "" if machine.is_bench else f"{machine.model}-{machine.bearing.designation}-"
        others = (None if self.running == Running(speed=self.speed) else self.running, self.gears)
        hashes = (hashlib.blake2b(repr(one).encode(), digest_size=6).hexdigest() for one in others if one is not None)
        return named + "".join(f"{one}-" for one in hashes)

    def _simulate(self, scene: Scene, duration: float | None = None) -> Response:
        """Return the response to a scene over a time, s; None is as long as a block needs.

        A motion that repeats with the ball passage is simulated for a while only, and known by its lines.
        """
        # Imported here, so that a rig that is only configured does not load the compiled kernels.
        from models.solve.simulate import simulate

        if duration is not None:
            return simulate(scene, duration=duration, rate=RATE)
        response = simulate(scene, duration=_REPEATED_SECONDS, rate=RATE)
        if response.record is None or response.repeats:
            return replace(response, record=None)
        # A ball period more than a block, which can then begin anywhere in it.
        return simulate(scene, duration=BLOCK_SECONDS + 1.0 / response.bpfo + 1.0 / RATE, rate=RATE)

    def _sampled(self, response: Response, phase: float) -> NDArray[np.float64]:
        """Return the acceleration of a block that begins at a phase of the ball passages, rad."""
        if response.record is None:
            return response.acceleration(RATE, BLOCK_SECONDS, phase=phase, sensor=self.sensor)
        begin = round(phase / (2.0 * math.pi) / response.bpfo * RATE)
        return response.record.of(self.sensor)[begin : begin + round(RATE * BLOCK_SECONDS)]

    @staticmethod
    def _background(rng: np.random.Generator, speed: float, t: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return shaft harmonics and broadband noise of 50 mg, m/s2; ``t``: times at which the shaft has a speed, s."""
        noise = rng.standard_normal(t.size, dtype=np.float32) * np.float32(_BACKGROUND)
        for order, amplitude in ((1, 0.02), (2, 0.03), (3, 0.01)):
            phase = float(rng.uniform(0.0, 2.0 * np.pi))
            tone = amplitude * STANDARD_GRAVITY * np.cos(2.0 * np.pi * order * speed * t + phase)
            noise += tone.astype(np.float32)
        return noise


_OPTIONS = {
    "seed": int,
    "healthy_blocks": int,
    "blocks": int,
    "load_newton": float,
    "speed_hz": float,
    "gain": float,
    "model": str,
    "bearing": str,
    "sensor": str,
    "fault": str,
    "slip_deg": float,
    "run": str,
    "run_s": float,
    "speed_to_hz": float,
    "hunt_percent": float,
    "hunt_hz": float,
    "tacho": int,
    "tacho_error_deg": float,
    "tacho_jitter_us": float,
    "tacho_missing": float,
    "tacho_extra": float,
    **_GEARS.OPTIONS,
}
_FROM_ZERO = ("tacho_error_deg", "tacho_jitter_us", "tacho_missing", "tacho_extra")
_NOT_NEGATIVE = ("seed", "slip_deg", "hunt_percent", "gear_eccentricity_um", *_FROM_ZERO)


def open_rig(url: str, name: str) -> SimulatedRig:
    """Open ``rig:NAME?seed=N&model=NAME``.

    Raises:
        SourceError: it names an unknown rig or option, a wrong value, or what the model does not describe.
    """
    where = f"[[source]] {name}: url {url!r}"
    options = _options(url, where)
    chosen = {key: options.pop(key) for key in ("model", "bearing", "sensor", "gain") if key in options}
    if chosen.get("sensor", SENSORS[0]) not in SENSORS:
        raise SourceError(f"{where}: sensor={chosen['sensor']!r} is none of {', '.join(SENSORS)}")
    seed = options.pop("seed", 0)
    try:
        kept = {"load_newton": "load", "healthy_blocks": "healthy_blocks", "blocks": "blocks"}
        opened = SimulatedRig(
            name,
            seed,
            **{argument: options.pop(key) for key, argument in kept.items() if key in options},
            machine=machine_of(**chosen),
            gears=_GEARS.gears_of({key: options.pop(key) for key in _GEARS.OPTIONS if key in options}),
            running=running_of(options, seed),
        )
        if not opened.machine.is_bench or opened.running != Running(speed=opened.speed):
            # Whatever the model refuses is refused here, and not after the healthy blocks.
            _ = opened.sensor
            if opened.running.marks is not None:
                opened._tacho(1, opened.rotation(1).turns_at(np.arange(_SAMPLES, dtype=np.float64) / RATE))
    except ValueError as error:
        raise SourceError(f"{where}: {error}") from None
    return opened


def _options(url: str, where: str) -> dict[str, Any]:
    """Return the options of a URL; raise SourceError where one is unknown or has a wrong value."""
    place, _, query = url.removeprefix("rig:").partition("?")
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
        if _OPTIONS[key] is str or (key in _NOT_NEGATIVE and options[key] >= 0):
            continue
        if key not in ("seed", "gear_db") and not options[key] > 0:
            raise SourceError(f"{where}: {key} must be positive, got {value}")
    return options
