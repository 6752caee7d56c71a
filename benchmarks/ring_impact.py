"""Time of a simulated second of impacts on rings, against scipy's methods for linear systems, and the errors of both.

python -m benchmarks.ring_impact [--quick] [--json FILE]

All compute the acceleration of the outer ring under the same pulses, from rest. Ours is compared with DOP853, cut at
both ends of each pulse (relative tolerance 1e-11), over the first 0.05 s; the others, which place pulses at their
samples, with ours over a second. Errors are RMS of the difference over RMS. ``simulate`` is all that a user waits for:
hits, oversampling, half the steps for the error, the recorder's filter.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from benchmarks.common import Row, arguments, interleaved_ms, print_table, write_json
from models.bearing import from_catalogue
from models.dynamics.ring_hits import hits_on
from models.dynamics.ring_impact import films, matrices, modes_of
from models.kernels.ring_impact import RECTANGLE, Modes, Pulses, Turn, add_response
from models.rigs.ring_impact import RingImpactRig
from models.scene import Defect, Part, Scene
from models.simulate import simulate
from tests.oracles import ring_impact_oracle as oracle

RATE = 48000.0
PARTS: tuple[Part, ...] = ("outer", "ball", "inner")
_COMPARED = 0.05
_STILL = Turn(0.0, 0.0)

Floats = NDArray[np.float64]


def scene_of(part: Part) -> Scene:
    """Return 6205 at 1750 rpm with a defect that is not hit at a sample."""
    return Scene(
        1750.0 / 60.0,
        1000.0,
        bearing=from_catalogue("6205"),
        rig=RingImpactRig(),
        defect=Defect(0.03, 1e-3, position=0.1, part=part),
    )


def ours(modes: Modes, pulses: Pulses, oversampling: int, seconds: float) -> Callable[[], Floats]:
    """Return the work of the kernel."""
    n, scratch = round(seconds * RATE * oversampling), np.empty((3, len(modes.rate)), np.complex128)

    def work() -> Floats:
        wave = np.zeros(n)
        add_response(wave, 1.0 / (RATE * oversampling), modes, pulses, _STILL, scratch)
        return wave

    return work


def linear_system(scene: Scene, part: Part) -> signal.StateSpace:
    """Return the system from the force on a part to the acceleration of the outer ring."""
    mass, damping, stiffness = matrices(scene)
    inverse = np.linalg.inv(mass)
    row = PARTS.index(part)
    a = np.block([[np.zeros((3, 3)), np.eye(3)], [-inverse @ stiffness, -inverse @ damping]])
    b = np.zeros((6, 1))
    b[3:, 0] = inverse[:, row]
    return signal.StateSpace(a, b, a[3:4], b[3:4])


def sampled(pulses: Pulses, oversampling: int, seconds: float) -> tuple[Floats, Floats]:
    """Return times and force at the samples."""
    t = np.arange(round(seconds * RATE * oversampling)) / (RATE * oversampling)
    force = np.zeros(len(t))
    for start, height in zip(pulses.start, pulses.force, strict=True):
        first, last = np.searchsorted(t, (start, start + pulses.width))
        force[first:last] += height
    return t, force


def lsim(scene: Scene, part: Part, pulses: Pulses, oversampling: int, *, interpolated: bool) -> Callable[[], Floats]:
    """Return the work of scipy.signal.lsim."""
    system, (t, force) = linear_system(scene, part), sampled(pulses, oversampling, 1.0)
    run: Any = signal.lsim
    return lambda: run(system, force, t, interp=interpolated)[1]


def filtered(scene: Scene, part: Part, pulses: Pulses, oversampling: int) -> Callable[[], Floats]:
    """Return the work of a zero-order hold and scipy.signal.sosfilt, the fastest that scipy has on a grid."""
    system: Any = linear_system(scene, part)
    held = system.to_discrete(1.0 / (RATE * oversampling), "zoh")
    with warnings.catch_warnings():
        # The numerator begins with nearly nothing where the force reaches the sensor through other masses.
        warnings.simplefilter("ignore", signal.BadCoefficients)
        zeros, poles, gain = signal.ss2zpk(held.A, held.B, held.C, held.D)
    sections, (_, force) = signal.zpk2sos(zeros, poles, gain), sampled(pulses, oversampling, 1.0)
    run: Any = signal.sosfilt
    return lambda: run(sections, force)


def against_dop853(scene: Scene, part: Part, modes: Modes, pulses: Pulses) -> tuple[float, Callable[[], Floats]]:
    """Return the kernel's error over the first of the time, and the work of the other."""
    rig, (outer, inner) = scene.rig_as(RingImpactRig), films(scene)
    machine = oracle.Machine(
        rig.m_o,
        rig.element_mass(scene.bearing),
        rig.m_i,
        rig.k_o,
        outer.stiffness,
        inner.stiffness,
        rig.k_i,
        outer.damping,
        inner.damping,
        rig.pulse,
        rig.pulse_width,
    )
    driven = [(float(t), float(f)) for t, f in zip(pulses.start, pulses.force, strict=True) if t < _COMPARED]
    t = np.arange(round(_COMPARED * RATE), dtype=np.float64) / RATE

    def work() -> Floats:
        return oracle.motion(machine, PARTS.index(part), driven, t)[2]

    return difference(ours(modes, pulses, 1, _COMPARED)(), work()), work


def difference(wave: Floats, reference: Floats) -> float:
    """Return the RMS of a difference over that of the reference."""
    return math.sqrt(float(np.mean((wave - reference) ** 2) / np.mean(reference**2)))


def rows_of(part: Part, rounds: int, *, quick: bool) -> list[Row]:
    """Return the rows of one defect."""
    scene = scene_of(part)
    hits, modes = hits_on(scene, 0, 0.0, 1.0), modes_of(scene, part)
    pulses = Pulses(hits.start, hits.force, scene.rig_as(RingImpactRig).pulse_width, RECTANGLE)
    exact = ours(modes, pulses, 1, 1.0)()
    error, independent = against_dop853(scene, part, modes, pulses)
    rows: list[Row] = []

    def add(name: str, setting: str, error: float | None, milliseconds: float) -> None:
        rows.append({"defect": part, "method": name, "grid": setting, "error": error, "ms per s": milliseconds})

    for factor in (1, 8):
        add("kernel", f"{factor} x 48 kHz", error, _timed(ours(modes, pulses, factor, 1.0), rounds))
    for factor in (1, 8):
        work = filtered(scene, part, pulses, factor)
        add("zero-order hold, sosfilt", f"{factor} x 48 kHz", difference(work()[::factor], exact), _timed(work, rounds))
    for factor in (1,) if quick else (1, 8):
        for interpolated in (False, True):
            work = lsim(scene, part, pulses, factor, interpolated=interpolated)
            name = "lsim, linear" if interpolated else "lsim, zero-order hold"
            add(name, f"{factor} x 48 kHz", difference(work()[::factor], exact), _timed(work, 1))
    add("DOP853, rtol 1e-11, cut at the pulses", "48 kHz", None, _timed(independent, 1) / _COMPARED)
    found = simulate(scene, duration=1.0, rate=RATE)
    add("simulate", "48 kHz", found.waveform_error, _timed(lambda: simulate(scene, duration=1.0, rate=RATE), rounds))
    return rows


def _timed(work: Callable[[], object], rounds: int) -> float:
    return interleaved_ms({"work": work}, rounds)["work"]


def main() -> None:
    """Print the table; write the JSON file if it was asked for."""
    options = arguments(__doc__ or "")
    parts = PARTS[2:] if options.quick else PARTS
    rows = [row for part in parts for row in rows_of(part, 3 if options.quick else 9, quick=options.quick)]
    print_table("impacts on rings: time of a simulated second", rows)
    write_json(options.json, {"rows": rows})


if __name__ == "__main__":
    main()
