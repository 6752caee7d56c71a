"""Impacts on rings that bend: the linear model of Sassi, Badri and Thomas (BEAT; JVC 13(11), 2007, 1603-1628).

Outer ring, element and inner ring are masses in a row, joined by oil films; each ring is held by the stiffness of its
elliptic mode (Eq. 25), and a defect drives the part that has it by one pulse a hit (``models.solve.ring_impact.hits``).
The only sensor, "mo", stands on the outer ring. The system is linear and is solved exactly
(``models.solve.ring_impact.kernel``) from a past so long that nothing of it is left out; only what happens between two
steps is unknown, to RMS, peak and record.

Readings, where the source is silent or misprinted:

* The element's row and column of the damping matrix are those of the stiffness matrix: C is of rank two.
* The film's clearance is radial, its load the largest of an element, its speed that of the shaft.
* Eq. 30 is taken to first order in the ring's deflection over its radius (``sensor_deflection`` is all of it), and
  its angle follows the defect, as printed. The sensor shows the acceleration of what it gives.
* The noise of slip is white from zero to 0.9 of the Nyquist frequency of the record, its RMS that of Eq. 32 with the
  contact at the inner race, which is the smaller.

Scale the model of impacts on rings to a machine by one defect of known size (BEAT, section 7 and Eq. 33).

What lies between bearing and sensor, and what the model lacks, becomes one gain of the impacts; what is left of the
measured RMS becomes the noise of slip. Other defects, speeds and loads of that machine are then predicted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from models.machine.bearing import kinematics
from models.machine.hertz import contact_patches
from models.machine.load_distribution import conforming
from models.solve.engine.motion import Motion, Planned, passage_rate
from models.solve.engine.over_time import answer, duration_of, expected_seconds
from models.solve.registry import Solver, check_effects
from models.solve.response import PASSBAND, Response
from models.solve.ring_impact import kernel as kernels
from models.solve.ring_impact.hits import Film, defect_size, hits_on, short_bearing_film, zones_of
from models.solve.ring_impact.rig import RingImpactRig
from models.words.numerics import fast_length
from models.words.request import Request, Sensor

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Part, Scene


MODEL = "ring_impact"
SENSORS: tuple[Sensor, ...] = ("mo",)
EFFECTS = frozenset(
    {
        "outer_defect",
        "inner_defect",
        "ball_defect",
        "several_defects",
        "first_row",
        "clearance",
        "roller",
        "outer_ring_turns",
        "slip",
        "axial_load",
        "rotating_load",
        "with_ring_modes",
    }
)
_ROW: dict[Part, int] = {"outer": 0, "ball": 1, "inner": 2}
_SHAPES = {"rectangle": kernels.RECTANGLE, "half_sine": kernels.HALF_SINE}
# Share of an impact that may be left of the past which is left out.
_FORGOTTEN = 1e-12
# Steps in a pulse, and in a period of the fastest mode, to begin with.
_STEPS_A_PULSE, _STEPS_A_PERIOD = 8.0, 6.0
# Eigenvectors worse conditioned belong to two modes that coincide; they are parted by changing the damping a little.
_WORST_CONDITION, _PARTED = 1e6, 1e-7
_LEAST_ERROR = 1e-5
_SECONDS_A_STEP = 1e-7


def films(scene: Scene) -> tuple[Film, Film]:
    """Return the films at outer and inner race."""
    rig = scene.rig_as(RingImpactRig)
    if rig.film_thickness is None or rig.film_clearance is None:
        return Film(rig.k_of, rig.c_of), Film(rig.k_if, rig.c_if)
    largest = max(zone.largest for zone in zones_of(scene))
    film = short_bearing_film(
        largest, 2.0 * math.pi * scene.speed, thickness=rig.film_thickness, clearance=rig.film_clearance
    )
    return film, film


def matrices(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return mass, damping and stiffness matrix of outer ring, element and inner ring, (3, 3) each (Eq. 25)."""
    rig = scene.rig_as(RingImpactRig)
    outer, inner = films(scene)
    first, second = np.array([1.0, -1.0, 0.0]), np.array([0.0, 1.0, -1.0])
    both = (np.outer(first, first), np.outer(second, second))
    damping = outer.damping * both[0] + inner.damping * both[1]
    stiffness = outer.stiffness * both[0] + inner.stiffness * both[1] + np.diag([rig.k_o, 0.0, rig.k_i])
    return np.diag([rig.m_o, rig.element_mass(scene.bearing), rig.m_i]), damping, stiffness


def natural_frequencies(scene: Scene) -> NDArray[np.float64]:
    """Return the three natural frequencies without damping, Hz, ascending."""
    from models.words.numerics import generalised_eigenvalues

    mass, _, stiffness = matrices(scene)
    return np.sqrt(generalised_eigenvalues(stiffness, mass)) / (2.0 * math.pi)


def modes_of(scene: Scene, part: Part) -> kernels.RingModes:
    """Return the system from the force on one part to the displacement of the outer ring.

    Where two modes coincide, the damping is taken larger by a ten-millionth, which parts them.
    """
    mass, damping, stiffness = matrices(scene)
    rate, vectors = _eigen(mass, damping, stiffness)
    scale = math.sqrt(stiffness[0, 0] / mass[0, 0])
    if np.linalg.cond(_even(vectors, scale)) > _WORST_CONDITION:
        rate, vectors = _eigen(mass, damping * (1.0 + _PARTED), stiffness)
    driven = np.zeros(6, dtype=np.complex128)
    driven[3 + _ROW[part]] = 1.0 / mass[_ROW[part], _ROW[part]]
    weight = vectors[0] * np.linalg.solve(vectors, driven)
    kept = rate.imag >= 0.0
    doubled = np.where(rate.imag > 0.0, 2.0, 1.0)
    direct = 1.0 / float(mass[0, 0]) if part == "outer" else 0.0
    return kernels.RingModes(rate[kept], (doubled * weight)[kept], direct)


def _eigen(
    mass: NDArray[np.float64], damping: NDArray[np.float64], stiffness: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return eigenvalues and eigenvectors of the first-order system of displacements and velocities."""
    inverse = 1.0 / np.diagonal(mass)[:, None]
    system = np.block([[np.zeros((3, 3)), np.eye(3)], [-inverse * stiffness, -inverse * damping]])
    rate, vectors = np.linalg.eig(system)
    return rate.astype(np.complex128), vectors.astype(np.complex128)


def _even(vectors: NDArray[np.complex128], scale: float) -> NDArray[np.complex128]:
    """Return the eigenvectors with velocities in the unit of the displacements, each of length one."""
    scaled = vectors * np.repeat([scale, 1.0], 3)[:, None]
    return scaled / np.linalg.norm(scaled, axis=0)


def noise_level(scene: Scene, constant: float | None = None) -> float:
    """Return the RMS of the noise of slip, m/s2 (Eq. 32), with the rig's K_N or another one."""
    rig = scene.rig_as(RingImpactRig)
    constant = rig.slip_noise if constant is None else constant
    largest = max(zone.largest for zone in zones_of(scene))
    if constant == 0.0 or largest == 0.0:
        return 0.0
    bearing = scene.bearing
    half_length, half_width = contact_patches(conforming(bearing), largest)[0]
    pressure = largest / (math.pi * half_length * half_width)
    ratio = bearing.element_diameter / bearing.pitch_diameter * math.cos(bearing.contact_angle)
    slip = rig.slip_ratio * 0.5 * math.pi * bearing.pitch_diameter * scene.speed * (1.0 - ratio**2)
    sizes = [defect_size(scene, defect) for defect in scene.defects if defect.moves_balls]
    weight = float(
        np.polynomial.polynomial.polyval(max(sizes, default=0.0) / bearing.element_diameter, rig.noise_weights)
    )
    return constant * math.sqrt(slip) * (pressure / 1e9) ** 2 * max(weight, 0.0)


def sensor_deflection(
    deflection: NDArray[np.float64], angle: NDArray[np.float64], radius: float
) -> NDArray[np.float64]:
    """Return what a sensor sees of a ring whose long axis, ``angle`` from it, has grown by ``deflection`` (Eq. 30).

    All of it, for comparison: the model uses the first order in deflection over radius, deflection * cos(2 angle).
    """
    squared = (np.sin(angle) / (radius - deflection)) ** 2 + (np.cos(angle) / (radius + deflection)) ** 2
    return squared**-0.5 - radius


@dataclass(frozen=True, eq=False)
class _Forces:
    """What acts during a run: impacts with the modes that they excite, and noise."""

    impacts: list[tuple[kernels.RingModes, kernels.ImpactPulses, kernels.Turn]]
    samples: int
    spectrum: NDArray[np.complex128]


class _FromRest:
    """The accelerations of a scene's sensor from t = 0 on, at which it has long been settled."""

    def __init__(self, scene: Scene, request: Request) -> None:
        """Prepare modes and noise; forces are those of the longest run so far."""
        self.noise, self._scene, self._request = noise_level(scene), scene, request
        self._damage = [
            (number, modes_of(scene, one.part)) for number, one in enumerate(scene.defects) if one.moves_balls
        ]
        self.fastest = max((float(np.max(np.abs(modes.rate.imag))) for _, modes in self._damage), default=0.0)
        self._planned = Planned(self._forces, duration_of(request, 0.0))

    def _forces(self, duration: float) -> _Forces:
        """Return the forces of a run of some seconds, those before that are still felt among them."""
        scene, rig = self._scene, self._scene.rig_as(RingImpactRig)
        impacts: list[tuple[kernels.RingModes, kernels.ImpactPulses, kernels.Turn]] = []
        for number, modes in self._damage:
            defect, slowest = scene.defects[number], -float(np.max(modes.rate.real))
            past = -math.log(_FORGOTTEN) / slowest if slowest > 0.0 else math.inf
            for row in range(defect.first_row, defect.first_row + defect.rows):
                hits = hits_on(scene, number, -past - rig.pulse_width, duration, row)
                pulses = kernels.ImpactPulses(hits.start, hits.force, rig.pulse_width, _SHAPES[rig.pulse])
                turn = kernels.Turn(0.0, 0.0)
                if rig.fixed_sensor:
                    turn = kernels.Turn(hits.angle - self._request.direction, hits.rate)
                impacts.append((modes, pulses, turn))
        samples = fast_length(math.ceil(duration * self._request.rate) + 2)
        return _Forces(impacts, samples, _noise_spectrum(self.noise, samples, rig.noise_seed))

    def __call__(self, steps: int, oversampling: int) -> tuple[NDArray[np.float64], bool]:
        """Return the accelerations of the outer ring, (steps, 1), and whether they are finite."""
        h, wave = 1.0 / (self._request.rate * oversampling), np.zeros(steps)
        forces = self._planned.until(steps * h)
        if self.noise > 0.0:
            wave += oversampling * np.fft.irfft(forces.spectrum, forces.samples * oversampling)[:steps]
        for modes, pulses, turn in forces.impacts:
            scratch = np.empty((3, len(modes.rate)), dtype=np.complex128)
            kernels.add_response(wave, h, modes, pulses, turn, scratch)
        return wave[:, None], bool(np.all(np.isfinite(wave)))


def _noise_spectrum(level: float, samples: int, seed: int) -> NDArray[np.complex128]:
    """Return the spectrum of white noise up to the end of the pass-band, of an expected RMS ``level``."""
    if level == 0.0:
        return np.zeros(1, dtype=np.complex128)
    spectrum = np.fft.rfft(np.random.default_rng(seed).standard_normal(samples))
    last = math.floor(PASSBAND * 0.5 * samples)
    spectrum[0], spectrum[last + 1 :] = 0.0, 0.0
    return spectrum * (level / math.sqrt(2.0 * last / samples))


def solve(scene: Scene, request: Request) -> Response:
    """Return the vibration of a scene over the time that a request names.

    Steps are halved until RMS and record meet the accuracy; at the steps themselves the response is exact. The
    status is "uncalibrated" where the parameters give its levels no unit (``RingImpactRig.scaled``).

    Raises:
        ValueError: if the scene or the request is outside what the model describes; the message names it.
    """
    rig = scene.rig_as(RingImpactRig)
    check_effects(scene, EFFECTS, MODEL)
    lines = kinematics(scene.bearing, scene.speed)
    from_rest = _FromRest(scene, request)
    repeats = scene.repeats and from_rest.noise == 0.0
    slowest = lines.ftf if "ball_defect" in scene.effects else lines.speed
    motion = Motion(
        from_rest=from_rest,
        sensors=SENSORS,
        model=MODEL,
        solver=SOLVER.name,
        bpfo=lines.bpfo,
        block=1.0 / (lines.bpfo if repeats else slowest),
        settle=0.0,
        repeats=repeats,
        passages=passage_rate(scene),
    )
    wished = max(_STEPS_A_PULSE / rig.pulse_width, _STEPS_A_PERIOD * from_rest.fastest / (2.0 * math.pi))
    found = answer(motion, request, 1.0 / wished)
    told = rig.scaled or found.rms == 0.0 or found.status == "not_converged"
    return found if told else replace(found, status="uncalibrated")


def _cost(scene: Scene, request: Request) -> float:
    """Return the expected processor time, s."""
    rig = scene.rig_as(RingImpactRig)
    fastest = math.sqrt(float(np.max(np.diagonal(matrices(scene)[2]) / np.diagonal(matrices(scene)[0]))))
    rate = max(request.rate, _STEPS_A_PULSE / rig.pulse_width, _STEPS_A_PERIOD * fastest / (2.0 * math.pi))
    return _SECONDS_A_STEP * rate * expected_seconds(scene, request)


def warm() -> None:
    """Compile the kernel: one scene with a defect."""
    from models.machine.bearing import from_catalogue
    from models.machine.scene import Defect, Scene

    scene = Scene(40.0, 1000.0, bearing=from_catalogue("6205"), rig=RingImpactRig(), defect=Defect(0.02, 1e-4))
    SOLVER.solve(scene, Request(duration=0.05, rate=25600.0))


SOLVER = Solver(
    model=MODEL,
    name="modal",
    effects=EFFECTS,
    error=_LEAST_ERROR,
    cost=_cost,
    solve=solve,
    reason="it is linear, so that each impact is added in closed form",
    rig=RingImpactRig,
)


Addition = Literal["quadrature", "linear"]


@dataclass(frozen=True)
class MeasuredLevel:
    """What was measured of one defect of known size.

    Attributes:
        rms: root mean square of the record, m/s2.
        kurtosis: fourth central moment over the squared variance, or None where it is not known.
        noise: RMS of the same machine without the defect, m/s2, or None; not used where the kurtosis is known.
    """

    rms: float
    kurtosis: float | None = None
    noise: float | None = None

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        if not (math.isfinite(self.rms) and self.rms > 0.0):
            raise ValueError(f"rms must be positive and finite, got {self.rms!r}")
        if self.kurtosis is not None and not (math.isfinite(self.kurtosis) and self.kurtosis >= 1.0):
            raise ValueError(f"kurtosis must be finite and 1 at least, got {self.kurtosis!r}")
        if self.noise is not None and not 0.0 <= self.noise < self.rms:
            raise ValueError(f"noise must lie between 0 and the RMS {self.rms!r}, got {self.noise!r}")


def noise_to_add(measured: float, simulated: float, addition: Addition = "quadrature") -> float:
    """Return the RMS of the noise that makes up a measured RMS (Eq. 33).

    Printed is the difference of both ("linear"); that of independent signals is the root of the difference of squares.

    Raises:
        ValueError: if more was simulated than measured.
    """
    if simulated > measured:
        raise ValueError(f"the simulated RMS {simulated!r} exceeds the measured one, {measured!r}: nothing is to add")
    if addition == "linear":
        return measured - simulated
    return math.sqrt(measured * measured - simulated * simulated)


def calibrate(
    scene: Scene, measured: MeasuredLevel, request: Request, *, addition: Addition = "quadrature"
) -> RingImpactRig:
    """Return the parameters of a scene's machine with the gain and the noise that a measurement of it asks for.

    With the kurtosis, impacts and noise are told apart by it: the excess of a sum of independent signals is that of
    the impacts times the square of their share of the power. Without, the noise is that of the undamaged machine, or
    none.

    Args:
        scene: the machine with the defect that was measured, and its speed and load.
        request: duration, rate and direction of the record that is compared.
        addition: how RMS values add up; see ``noise_to_add``.

    Raises:
        ValueError: if the defect is not hit, or no share of noise gives the kurtosis that was measured.
    """
    rig = replace(scene.rig_as(RingImpactRig), gain=1.0, slip_noise=0.0)
    found = solve(replace(scene, rig=rig), request)
    if found.record is None or found.rms == 0.0:
        raise ValueError("defect: it is not hit, so that there is nothing to scale")
    level, excess = _level_and_excess(found.record.of())
    if measured.kurtosis is not None:
        share = (measured.kurtosis - 3.0) / excess if excess != 0.0 else math.inf
        if not 0.0 <= share <= 1.0:
            raise ValueError(
                f"kurtosis {measured.kurtosis!r} does not lie between that of noise, 3, and that of the impacts "
                f"alone, {3.0 + excess:.4g}, which the damping of the films decides"
            )
        impacts = measured.rms * share**0.25
    else:
        noise = measured.noise or 0.0
        impacts = measured.rms - noise if addition == "linear" else math.sqrt(measured.rms**2 - noise**2)
    noise = noise_to_add(measured.rms, impacts, addition)
    unit = noise_level(replace(scene, rig=rig), 1.0)
    return replace(rig, gain=impacts / level, slip_noise=noise / unit)


def _level_and_excess(signal: NDArray[np.float64]) -> tuple[float, float]:
    """Return the RMS of a signal without its mean, and its kurtosis less 3."""
    moved = signal - np.mean(signal)
    square = float(np.mean(moved**2))
    return math.sqrt(square), float(np.mean(moved**4)) / square**2 - 3.0
