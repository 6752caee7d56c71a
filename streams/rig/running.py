"""How the shaft of a simulated rig turns in a block, and the tacho that watches it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from models.machine.scene import PARTS, Part, Slip
from models.machine.shaft_marks import ShaftMarks, TimeAt, as_channel
from models.machine.speed_profile import SpeedProfile, coast_down, hunt, ramp

Run = Literal["steady", "ramp", "coast", "hunt"]
RUNS: tuple[Run, ...] = get_args(Run)
TACHO_CHANNEL = "tacho"

_HELD = 0.001
"""Relative standard deviation of the speeds that the drive is set to, from block to block."""

_OF_RUN = {"speed_hz": "speed", "speed_to_hz": "speed_to", "run": "run", "run_s": "seconds", "hunt_hz": "hunt_hz"}
_OF_MARKS = {"tacho_missing": ("missing", 1.0), "tacho_extra": ("extra", 1.0), "tacho_jitter_us": ("jitter", 1e-6)}


@dataclass(frozen=True)
class Running:
    """The rotation of a rig; blocks are taken from a run that is drawn anew for each.

    Attributes:
        run: "steady"; "ramp", evenly from one speed to another; "coast", down exponentially; "hunt", about one speed.
        speed: at the beginning of a run, or its mean, Hz.
        speed_to: at its end, Hz; None is four times the speed of a ramp, and a quarter of it of coasting.
        seconds: of a run up or down; a block begins anywhere in it where it is longer than a block.
        share: amplitude of the hunting over its mean.
        hunt_hz: frequency of the hunting.
        marks: of the tacho, or None without one.
        slip: largest angle by which balls slip, rad.
        fault: the part that wears out.
    """

    run: Run = "steady"
    speed: float = 40.0
    speed_to: float | None = None
    seconds: float = 5.0
    share: float = 0.1
    hunt_hz: float = 0.3
    marks: ShaftMarks | None = None
    slip: float = 0.0
    fault: Part = "outer"

    def __post_init__(self) -> None:
        """Raise a ValueError where a run has speeds that it cannot have."""
        if self.run not in RUNS:
            raise ValueError(f"run must be one of {', '.join(RUNS)}, got {self.run!r}")
        if self.run == "coast" and not self.end < self.speed:
            raise ValueError(f"speed_to_hz must be below speed_hz of a coast-down, got {self.end!r} Hz")
        if self.slip > 0.0 and self.fault == "ball":
            raise ValueError("slip_deg moves a ball to or from a defect of a race; the fault is of a ball")
        if not 0.0 <= self.share < 1.0:
            raise ValueError(f"hunt_percent must lie between 0 and 100, got {100.0 * self.share:g}")

    @property
    def varies(self) -> bool:
        """Whether the speed changes within a block."""
        return self.run != "steady"

    @property
    def end(self) -> float:
        """Speed at the end of a run, Hz."""
        if self.speed_to is not None:
            return self.speed_to
        return self.speed * {"ramp": 4.0, "coast": 0.25}.get(self.run, 1.0)

    @property
    def fastest(self) -> float:
        """Highest speed of a run, Hz."""
        return self.speed * (1.0 + self.share) if self.run == "hunt" else max(self.speed, self.end)

    def profile(self, seed: int, sequence: int, seconds: float) -> SpeedProfile:
        """Return the rotation over a block of so many seconds."""
        rng = np.random.default_rng([seed, 4, sequence])
        held = 1.0 + _HELD * float(rng.standard_normal())
        begin, end = held * self.speed, held * self.end
        if self.run == "hunt":
            phase = float(rng.uniform(0.0, 2.0 * math.pi))
            return hunt(begin, self.share, self.hunt_hz, seconds, phase=phase)
        whole = max(self.seconds, seconds)
        kinds = {"ramp": ramp, "coast": coast_down, "steady": ramp}
        run = kinds[self.run](begin, end, whole)
        return run.part(float(rng.uniform(0.0, whole - seconds)) if whole > seconds else 0.0, seconds)

    def slip_of(self, sequence: int) -> Slip | None:
        """Return the slip of the balls in a block."""
        return Slip(self.slip, seed=sequence) if self.slip > 0.0 else None

    def tacho(
        self, time_at: TimeAt, profile: SpeedProfile, sequence: int, samples: int, rate: float
    ) -> NDArray[np.float32]:
        """Return the channel of the tacho, V, shape (samples,).

        Raises:
            ValueError: the marks pass too fast for the rate.
        """
        assert self.marks is not None
        end = samples / rate
        pulses = self.marks.pulses(time_at, float(profile.turns_at(end)), end, sequence)
        return as_channel(pulses, samples, rate, self.marks.per_turn * profile.speed_range[1])


def running_of(options: dict[str, Any], seed: int) -> Running:
    """Return how a rig runs, from its options; raise a ValueError where they do not fit together."""
    of_tacho = [key for key in options if key.startswith("tacho_")]
    if of_tacho and "tacho" not in options:
        raise ValueError(f"{of_tacho[0]} belongs to tacho, the number of pulses a turn")
    if options.get("fault", PARTS[0]) not in PARTS:
        raise ValueError(f"fault={options['fault']!r} is none of {', '.join(PARTS)}")
    if options.get("run", RUNS[0]) not in RUNS:
        raise ValueError(f"run={options['run']!r} is none of {', '.join(RUNS)}")
    marks = None
    if "tacho" in options:
        faults = {name: one * options[key] for key, (name, one) in _OF_MARKS.items() if key in options}
        error = math.radians(options.get("tacho_error_deg", 0.0))
        marks = ShaftMarks(options["tacho"], error=error, seed=seed, **faults)
    return Running(
        **{argument: options[key] for key, argument in _OF_RUN.items() if key in options},
        share=0.01 * options.get("hunt_percent", 100.0 * Running.share),
        marks=marks,
        slip=math.radians(options.get("slip_deg", 0.0)),
        fault=options.get("fault", Running.fault),
    )
