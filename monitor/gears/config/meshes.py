"""A pair of ``[gear]`` as a mesh of the model: its geometry, stiffness, backlash and the faults of its wheels."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from models.gears.teeth.faults import Eccentricity, GearFault
from models.gears.teeth.geometry import GearPair, TipRelief, ToothedWheel
from models.gears.teeth.mesh import GearTableError, MeshStiffness
from models.gears.teeth.rack import BasicRack
from models.gears.teeth.stiffness import mesh_stiffness
from monitor.gears.config.parts import GearFaultSection, GearPairSection, GearWheelSection

_MM, _UM = 1e-3, 1e-6


@dataclass(frozen=True)
class PairModel:
    """A pair with its wheels and their faults.

    Attributes:
        section: of the pair.
        wheels: driver and driven wheel.
        faults: of both wheels.
    """

    section: GearPairSection
    wheels: tuple[GearWheelSection, GearWheelSection]
    faults: tuple[tuple[GearFaultSection, ...], tuple[GearFaultSection, ...]] = ((), ())

    @property
    def teeth(self) -> tuple[int, int]:
        """Teeth of both wheels."""
        return self.wheels[0].teeth, self.wheels[1].teeth

    @property
    def knows_teeth(self) -> bool:
        """Whether the form of the teeth is given: module, face width and bore."""
        whole = all(wheel.face_width_mm is not None and wheel.bore_mm is not None for wheel in self.wheels)
        return whole and self.section.module_mm is not None

    @cached_property
    def geometry(self) -> GearPair | None:
        """The teeth of both wheels, None where their form is not given.

        Raises:
            ValueError: they cannot be made or mesh.
        """
        pair = self.section
        if not self.knows_teeth or pair.module_mm is None:
            return None
        return GearPair(
            _toothed(self.wheels[0]),
            _toothed(self.wheels[1]),
            pair.module_mm * _MM,
            math.radians(pair.pressure_angle_deg),
            math.radians(pair.helix_angle_deg),
            None if pair.centre_distance_mm is None else pair.centre_distance_mm * _MM,
            BasicRack(pair.addendum, pair.dedendum, pair.fillet_radius),
        )

    @property
    def _transverse_angle(self) -> float:
        """Transverse pressure angle at the reference circle, rad."""
        helix = math.radians(self.section.helix_angle_deg)
        return math.atan(math.tan(math.radians(self.section.pressure_angle_deg)) / math.cos(helix))

    @property
    def base_radii(self) -> tuple[float, float]:
        """Base radii, m."""
        assert self.section.module_mm is not None
        radius = 0.5 * self.section.module_mm * _MM / math.cos(math.radians(self.section.helix_angle_deg))
        per_tooth = radius * math.cos(self._transverse_angle)
        return per_tooth * self.teeth[0], per_tooth * self.teeth[1]

    @property
    def working_angle(self) -> float:
        """Transverse working pressure angle, rad."""
        if self.geometry is not None:
            return self.geometry.working_angle
        if self.section.centre_distance_mm is None:
            return self._transverse_angle
        return math.acos(sum(self.base_radii) / (self.section.centre_distance_mm * _MM))

    @property
    def distance(self) -> float:
        """Distance of the axes, m."""
        return sum(self.base_radii) / math.cos(self.working_angle)

    @property
    def backlash(self) -> float:
        """Backlash along the line of action, m; infinite where neither key nor centre distance give one."""
        if self.section.backlash_um is not None:
            return self.section.backlash_um * _UM
        return self.geometry.backlash if self.geometry is not None and self.geometry.backlash > 0.0 else math.inf

    @property
    def base_helix(self) -> float:
        """Helix angle on the base cylinder, rad."""
        sine = math.sin(math.radians(self.section.helix_angle_deg))
        return math.asin(sine * math.cos(math.radians(self.section.pressure_angle_deg)))

    @property
    def contact_ratio(self) -> float | None:
        """Total contact ratio, None where it is not known."""
        return self.section.contact_ratio if self.geometry is None else self.geometry.contact_ratio

    def mean_stiffness(self) -> float:
        """Return a mean stiffness with which the mean forces can be computed before the teeth are, N/m."""
        return self.section.stiffness_newton_per_m or 1e8

    def stiffness(self, force: float) -> MeshStiffness:
        """Return stiffness and errors under a mean force along the line of action, N.

        Raises:
            GearTableError: the file of a given stiffness cannot be used.
            ValueError: a fault does not fit, or no force presses the teeth whose stiffness depends on it.
        """
        mean = self.section.stiffness_newton_per_m
        given = self._given_course()
        if given is None:
            assert self.geometry is not None
            if not force > 0.0:
                raise ValueError("no torque passes this mesh; give its stiffness_newton_per_m")
            first, second = (self._to_faults(side) for side in (0, 1))
            found = mesh_stiffness(self.geometry, force, driver_faults=first, driven_faults=second)
            return found if mean is None else found.scaled_to(mean)
        for side, name in enumerate(("driver_error", "driven_error")):
            for fault in self._to_faults(side):
                if isinstance(fault, Eccentricity):
                    added = fault.errors(self.teeth[side] * given.samples)
                    before = getattr(given, name)
                    given = replace(given, **{name: added if before is None else before + added})
        return given

    @property
    def computed(self) -> bool:
        """Whether the course of the stiffness is computed from the teeth."""
        return self.knows_teeth and self.section.stiffness_csv is None and self.section.stiffness_variation is None

    def _given_course(self) -> MeshStiffness | None:
        """Return the stiffness that the keys give, None where it is computed from the teeth."""
        pair, mean = self.section, self.section.stiffness_newton_per_m
        if pair.stiffness_csv is not None:
            found = self._read_course()
            return found if mean is None else found.scaled_to(mean)
        if self.computed:
            return None
        assert mean is not None
        if pair.stiffness_variation is not None and pair.contact_ratio is not None:
            return MeshStiffness.rectangular(self.teeth, mean, pair.stiffness_variation, pair.contact_ratio)
        return MeshStiffness.harmonic(self.teeth, mean, [])

    def _read_course(self) -> MeshStiffness:
        path = self.section.stiffness_csv
        assert path is not None
        try:
            text = path.read_text(encoding="utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            raise GearTableError(f"stiffness_csv {path}: cannot be read: {error}") from None
        return MeshStiffness.from_csv(self.teeth, text, str(path))

    def _to_faults(self, side: int) -> list[GearFault]:
        return [fault.to_fault(self.teeth[side]) for fault in self.faults[side]]

    def excitation_words(self, stiffness: MeshStiffness) -> str:
        """Return in words where the stiffness is from, and whether it excites anything."""
        if self.computed:
            return "from the teeth"
        return "given" if np.ptp(stiffness.base) > 0.0 else "given as constant: it excites nothing"


def _toothed(wheel: GearWheelSection) -> ToothedWheel:
    assert wheel.face_width_mm is not None
    assert wheel.bore_mm is not None
    relief = None
    if wheel.tip_relief_um and wheel.tip_relief_length_mm is not None:
        relief = TipRelief(wheel.tip_relief_um * _UM, wheel.tip_relief_length_mm * _MM, wheel.tip_relief_shape)
    return ToothedWheel(
        teeth=wheel.teeth,
        face_width=wheel.face_width_mm * _MM,
        hub_radius=0.5 * wheel.bore_mm * _MM,
        profile_shift=wheel.profile_shift,
        truncation=wheel.tip_truncation_mm * _MM,
        tip_relief=relief,
        modulus=wheel.modulus_gpa * 1e9,
        poisson=wheel.poisson,
    )
