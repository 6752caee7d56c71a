"""Gears beside the bearing of a simulated rig: their vibration comes from the model of a gear train.

Two spur wheels of 3 mm module, 30 mm wide, one on the shaft of the bearing. The train is simulated once, at the mean
speed, over as many turns as bring the same teeth together again (or up to ``MAX_SECONDS``, over turns after which the
driven wheel stands nearly as before). The force of the driver's support, through two modes of the structure, is what
the sensors show. Blocks replay it by the angle of the shaft, from anywhere; where the speed varies, resonances of the
train move with it, those of the structure do not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from models.gears.teeth.faults import Eccentricity, GearFault, PitchError, ToothCrack, ToothSpall
from models.gears.teeth.geometry import GearPair, TipRelief, ToothedWheel
from models.gears.train.parts import Body, GearTrain, Mesh, Support, Wheel, alike, line_of_action

Samples = NDArray[np.float64]
GearState = Literal["loaded", "idle"]
FaultKind = Literal["crack", "spall", "pitch", "eccentric"]
STATES: tuple[GearState, ...] = get_args(GearState)
FAULT_KINDS: tuple[FaultKind, ...] = get_args(FaultKind)

LEVEL_BAND = (1000.0, 10_000.0)
"""Band in which the level of the loaded gears over the background is stated, Hz."""
MAX_SECONDS = 4.0
"""Longest simulation of the train."""
OPTIONS = {
    "gear": str,
    "gear_db": float,
    "gear_eccentricity_um": float,
    "gear_state": str,
    "gear_fault": str,
    "gear_fault_size": float,
    "gear_fault_block": int,
}
"""Options of a URL."""

_MODULE, _FACE, _PRESSURE = 3e-3, 30e-3, math.radians(20.0)
_RELIEF = TipRelief(amount=6e-6, length=2e-3)
_BACKLASH = 60e-6
_FORCE: Mapping[GearState, float] = {"loaded": 3000.0, "idle": 10.0}
"""Mean force along the line of action, N."""
_SEEDS = 2**31
_PITCH_SD = 1.5e-6
"""Standard deviation of the pitches of both wheels, m."""
_DENSITY, _SUPPORT, _ATTACHED = 7850.0, 2e8, 4.0
"""kg/m3; stiffness of the supports, N/m; inertia of what turns with a wheel over its own."""
_MODES = ((1900.0, 0.04), (4700.0, 0.03))
"""Frequency, Hz, and damping of the modes of the structure, of one effective mass."""
_RATE = 51_200.0
# The driven wheel where a URL gives the driver alone: three times as many teeth, and two.
_RATIO, _MORE = 3, 2


@dataclass(frozen=True)
class RigGears:
    """Gears of a rig.

    Attributes:
        driver, driven: teeth; the driver is on the shaft of the bearing.
        db: level of the gears, loaded and sound, over the background of the rig in ``LEVEL_BAND``, RMS, dB.
        eccentricity: of both wheels, m.
        state: "loaded", or "idle", where the teeth part and rattle as the model says.
        fault: of a wheel, or None.
        faulty: the wheel, "driver" or "driven".
        size: of the fault: a crack 1.6 modules deep, a spall as wide as the face, a tooth 50 um out of place, a centre
            100 um off the axis, times this.
        since: number of the first block with the fault: a monitor takes what it learns for healthy.
    """

    driver: int
    driven: int
    db: float = 10.0
    eccentricity: float = 15e-6
    state: GearState = "loaded"
    fault: FaultKind | None = None
    faulty: Literal["driver", "driven"] = "driver"
    size: float = 0.5
    since: int = 1

    def __post_init__(self) -> None:
        """Raise a ValueError that names the option which is unusable."""
        for key, value, known in (("gear_state", self.state, STATES), ("gear_fault", self.fault, (None, *FAULT_KINDS))):
            if value not in known:
                raise ValueError(f"{key}={value!r} is none of {', '.join(name for name in known if name)}")
        if self.faulty not in ("driver", "driven"):
            raise ValueError(f"gear_fault: the wheel is driver or driven, got {self.faulty!r}")
        if not (math.isfinite(self.db) and self.db <= 60.0):
            raise ValueError(f"gear_db must be finite and at most 60, got {self.db!r}")
        if not 0.0 <= self.eccentricity <= 1e-3:
            raise ValueError(f"gear_eccentricity_um must be from 0 to 1000, got {1e6 * self.eccentricity:g}")
        if not 0.0 < self.size <= 1.0:
            raise ValueError(f"gear_fault_size must be above 0 and at most 1, got {self.size!r}")
        try:
            _pair(self)
        except ValueError as error:
            raise ValueError(f"gear={self.driver}/{self.driven}: {error}") from None

    def in_block(self, sequence: int) -> RigGears:
        """Return the gears as they are in a block, from 1: sound before the fault."""
        return replace(self, fault=self.fault if sequence >= self.since else None, since=1)

    @property
    def words(self) -> str:
        """What runs beside the bearing, for people."""
        since = f" from block {self.since}" if self.since > 1 else ""
        fault = "" if self.fault is None else f", with a fault of the {self.faulty} ({self.fault}){since}"
        return f"gears of {self.driver} and {self.driven} teeth, {self.state}, run beside the bearing{fault}"


def gears_of(options: Mapping[str, Any]) -> RigGears | None:
    """Return the gears that the options of a URL state, None where there are none; raise a ValueError of wrong ones."""
    if "gear" not in options:
        if options:
            raise ValueError(f"{next(iter(options))} belongs to gear, the teeth such as 23/71")
        return None
    text = str(options["gear"])
    driver, slash, driven = text.partition("/")
    if not driver.isdecimal() or (slash and not driven.isdecimal()):
        raise ValueError(f"gear={text!r}: expected teeth such as 23, or 23/71 of driver and driven wheel")
    faulty, colon, kind = str(options.get("gear_fault", "")).rpartition(":")
    given = {"db": "gear_db", "state": "gear_state", "size": "gear_fault_size", "since": "gear_fault_block"}
    found: dict[str, Any] = {name: options[key] for name, key in given.items() if key in options}
    if "gear_eccentricity_um" in options:
        found["eccentricity"] = 1e-6 * options["gear_eccentricity_um"]
    if "gear_fault" in options:
        found |= {"fault": kind, "faulty": faulty if colon else "driver"}
    teeth = int(driver)
    return RigGears(teeth, int(driven) if slash else _RATIO * teeth + _MORE, **found)


def gear_train(gears: RigGears, speed: float, seed: int) -> GearTrain:
    """Return the train at a speed, Hz; pitch errors and phases are drawn by the seed."""
    from models.gears.teeth.stiffness import mesh_stiffness

    pair = _pair(gears)
    force = _FORCE[gears.state]
    rng = np.random.default_rng([seed, 5])
    faults: list[list[GearFault]] = []
    for name, wheel in zip(("driver", "driven"), pair.wheels, strict=True):
        phase, drawn = rng.uniform(0.0, math.tau), int(rng.integers(_SEEDS))
        own: list[GearFault] = [Eccentricity(gears.eccentricity, phase)]
        own.append(PitchError.drawn(wheel.teeth, _PITCH_SD, drawn))
        if name == gears.faulty:
            own += _faults(gears, wheel)
        faults.append(own)
    # Under the force without load, pitch errors would leave one pair in contact: the tables are those under load.
    stiffness = mesh_stiffness(pair, _FORCE["loaded"], samples=64, driver_faults=faults[0], driven_faults=faults[1])
    bodies: list[Body] = []
    for name, radius in zip(("driver", "driven"), pair.base_radii, strict=True):
        mass = _DENSITY * math.pi * radius**2 * _FACE
        damper = 0.06 * math.sqrt(_SUPPORT * mass)
        bodies.append(
            Body(
                name,
                mass,
                (1.0 + _ATTACHED) * 0.5 * mass * radius**2,
                (Support(name, alike(_SUPPORT), alike(damper)),),
                torque=0.0 if name == "driver" else -force * radius,
            )
        )
    lines = [line_of_action(0.0, pair.working_angle, counterclockwise=True, back=back) for back in (False, True)]
    reduced = 1.0 / math.fsum(r * r / body.inertia for r, body in zip(pair.base_radii, bodies, strict=True))
    return GearTrain(
        bodies=tuple(bodies),
        wheels=tuple(
            Wheel(body.name, body.name, wheel.teeth, radius)
            for body, wheel, radius in zip(bodies, pair.wheels, pair.base_radii, strict=True)
        ),
        meshes=(
            Mesh(
                "driver",
                "driven",
                stiffness,
                *lines,
                damping=0.14 * math.sqrt(stiffness.mean * reduced),
                backlash=_BACKLASH,
            ),
        ),
        drive="driver",
        speed=speed,
    )


@dataclass(frozen=True, eq=False)
class GearSound:
    """The force of gears over the angle, and what the sensors show of it.

    Attributes:
        force: along the sensor, N, at equal steps of angle, shape (step,).
        turns: of the driver over all steps.
        gain: m/s2 of the sensor over the answer of the structure, whose effective mass it holds.
        out_of_contact: share of the time in which the teeth are apart.
    """

    force: Samples
    turns: float
    gain: float
    out_of_contact: float

    def at(self, turns: NDArray[np.floating], rate: float) -> Samples:
        """Return the acceleration at the sensor, m/s2, while the shaft is at such turns, shape (sample,)."""
        place = turns / self.turns % 1.0 * self.force.size
        low = place.astype(np.intp) % self.force.size
        share = place - np.floor(place)
        force = (1.0 - share) * self.force[low] + share * self.force[(low + 1) % self.force.size]
        return self.gain * through_structure(force, rate)


def through_structure(force: Samples, rate: float) -> Samples:
    """Return the acceleration of two modes of a structure of unit effective mass, shape (sample,)."""
    frequency = np.fft.rfftfreq(force.size, 1.0 / rate)
    answer = np.zeros(frequency.size, dtype=np.complex128)
    for natural, damping in _MODES:
        share = frequency / natural
        answer += -np.square(share) / (1.0 - np.square(share) + 2j * damping * share)
    return np.fft.irfft(np.fft.rfft(force) * answer, force.size)


@lru_cache(maxsize=8)
def gear_sound(gears: RigGears, speed: float, fastest: float, seed: int, rate: float, background: float) -> GearSound:
    """Simulate the gears of a machine.

    Args:
        gears: the gears.
        speed: at which they are simulated, Hz.
        fastest: at which they are replayed, Hz: what would pass half the rate there is left out.
        seed: of the machine.
        rate: of the sensors, Hz.
        background: RMS of the noise of the sensors up to half the rate, m/s2.
    """
    force, apart, count = _simulated(gears, speed, seed)
    sound = replace(gears, state="loaded", fault=None)
    reference = force if gears == sound else _simulated(sound, speed, seed)[0]
    heard = through_structure(_below(reference, 0.45 * rate), _RATE)
    noise = background * math.sqrt((LEVEL_BAND[1] - LEVEL_BAND[0]) / (0.5 * rate))
    gain = 10.0 ** (gears.db / 20.0) * noise / max(_rms_in_band(heard, _RATE), np.finfo(np.float64).tiny)
    return GearSound(_below(force, 0.45 * rate * speed / fastest), count, gain, apart)


def replayed_turns(gears: RigGears, speed: float) -> int:
    """Return how many turns of the driver are simulated: a hunting period, or what comes nearest within the limit."""
    whole = gears.driven // math.gcd(gears.driver, gears.driven)
    most = max(1, math.floor(MAX_SECONDS * speed))
    if whole <= most:
        # A short period is repeated: it would be a pure line spectrum either way.
        return whole
    turns = np.arange(max(1, most // 2), most + 1)
    driven = turns * gears.driver / gears.driven
    return int(turns[np.argmin(np.abs(driven - np.rint(driven)))])


def _simulated(gears: RigGears, speed: float, seed: int) -> tuple[Samples, float, float]:
    """Return the force over whole turns, the share of the time out of contact, and how many turns."""
    from models.gears.train.motion import simulate_train

    count = replayed_turns(gears, speed)
    steps = round(count / speed * _RATE)
    # The rate is drawn to whole steps over the turns.
    motion = simulate_train(gear_train(gears, speed, seed), duration=count / speed, rate=steps * speed / count)
    if not motion.finite:
        raise ValueError(f"gear={gears.driver}/{gears.driven}: the train does not stay finite at {speed:g} Hz")
    force = motion.bearing_forces()["driver"][:steps, 1]
    return force - force.mean(), float(motion.out_of_contact[0]), float(count)


def _pair(gears: RigGears) -> GearPair:
    wheels: list[ToothedWheel] = []
    for teeth in (gears.driver, gears.driven):
        # A little more than what avoids undercut.
        shift = max(0.0, 1.01 - 0.5 * teeth * math.sin(_PRESSURE) ** 2)
        hub = 0.3 * _MODULE * teeth
        wheels.append(ToothedWheel(teeth, _FACE, hub, profile_shift=shift, tip_relief=_RELIEF))
    return GearPair(wheels[0], wheels[1], _MODULE, _PRESSURE)


def _faults(gears: RigGears, wheel: ToothedWheel) -> list[GearFault]:
    """Return the fault that is asked for, of tooth 0."""
    size = gears.size
    by_kind: dict[FaultKind | None, list[GearFault]] = {
        None: [],
        "crack": [ToothCrack(0, size * 1.6 * _MODULE)],
        "spall": [ToothSpall(0, _MODULE, size * _FACE, 100e-6)],
        "pitch": [PitchError.of_tooth(wheel.teeth, 0, size * 50e-6)],
        "eccentric": [Eccentricity(size * 100e-6)],
    }
    return by_kind[gears.fault]


def _below(force: Samples, limit: float) -> Samples:
    """Return a periodic force at ``_RATE`` without what is above a frequency, Hz."""
    spectrum = np.fft.rfft(force)
    spectrum[np.fft.rfftfreq(force.size, 1.0 / _RATE) > limit] = 0.0
    return np.fft.irfft(spectrum, force.size)


def _rms_in_band(x: Samples, rate: float) -> float:
    power = np.square(np.abs(np.fft.rfft(x)))
    frequency = np.fft.rfftfreq(x.size, 1.0 / rate)
    inside = (frequency >= LEVEL_BAND[0]) & (frequency <= LEVEL_BAND[1])
    return math.sqrt(2.0 * float(power[inside].sum())) / x.size
