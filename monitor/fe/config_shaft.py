"""File of a shaft for finite elements: its steps, the seat of the test bearing, and its support bearings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, ValidationError, model_validator

from models.fe.meshes.shaft_mesh import Step
from models.fe.shafts.shaft import ShaftSeat, ShaftSupport, SteppedShaft
from models.fe.shafts.spring import bearing_spring
from models.machine.bearing import CatalogueEntry, catalogue_entry
from models.machine.contact_estimates import estimate_stiffness
from monitor.config.explain import explain_problems
from monitor.config.fields import NotNegative, Positive, Section
from monitor.config.load import ConfigError, read_toml, sort_problems
from monitor.config.positions import find_lines

_MM = 1e-3


class StepSection(Section):
    """A length of shaft of one diameter."""

    length_mm: Positive
    diameter_mm: Positive
    bore_mm: NotNegative = 0.0

    @model_validator(mode="after")
    def _hollow(self) -> Self:
        if self.bore_mm >= self.diameter_mm:
            raise ValueError(f"bore_mm must be less than diameter_mm, {self.diameter_mm:g}, got {self.bore_mm:g}")
        return self

    def to_step(self) -> Step:
        """Return the step in SI."""
        return Step(_MM * self.length_mm, _MM * self.diameter_mm, _MM * self.bore_mm)


class ShaftSeatSection(Section):
    """Where a bearing sits, in mm from the first end of the shaft."""

    from_mm: NotNegative
    to_mm: Positive

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.to_mm <= self.from_mm:
            raise ValueError(f"to_mm must be more than from_mm, {self.from_mm:g}, got {self.to_mm:g}")
        return self

    def to_seat(self) -> ShaftSeat:
        """Return the seat in SI."""
        return ShaftSeat(_MM * self.from_mm, _MM * self.to_mm)


class SupportSection(ShaftSeatSection):
    """A support bearing of the catalogue; its contact stiffness is estimated where it is not given."""

    bearing: str
    clearance_um: NotNegative = 0.0
    k_c_newton_per_m15: Positive | None = None
    k_c_newton_per_m109: Positive | None = None
    tilt_newton_m_per_rad: NotNegative = 0.0

    @model_validator(mode="after")
    def _known(self) -> Self:
        element = self.to_entry().bearing.element
        if element == "ball" and self.k_c_newton_per_m109 is not None:
            raise ValueError(f"k_c_newton_per_m109 is that of a roller; {self.bearing} has balls: k_c_newton_per_m15")
        if element == "roller" and self.k_c_newton_per_m15 is not None:
            raise ValueError(f"k_c_newton_per_m15 is that of a ball; {self.bearing} has rollers: k_c_newton_per_m109")
        return self

    def to_entry(self) -> CatalogueEntry:
        """Return the bearing; a ValueError where the catalogue does not have it."""
        try:
            return catalogue_entry(self.bearing)
        except KeyError as error:
            raise ValueError(f"bearing: {error.args[0]}") from None

    def to_support(self) -> ShaftSupport:
        """Return the support in SI.

        Raises:
            ValueError: the geometry of the bearing does not give its contact stiffness.
        """
        estimate = estimate_stiffness(self.to_entry())
        given = self.k_c_newton_per_m15 or self.k_c_newton_per_m109
        spring = bearing_spring(estimate.bearing, given or estimate.value, 1e-6 * self.clearance_um)
        return ShaftSupport(self.to_seat(), spring, self.tilt_newton_m_per_rad)


class ShaftFile(Section):
    """A shaft with its bearings."""

    step: tuple[StepSection, ...] = Field(min_length=1)
    load: ShaftSeatSection
    support: tuple[SupportSection, ...] = Field(min_length=1)
    modulus_gpa: Positive = 210.0
    poisson: Annotated[float, Field(ge=0.0, lt=0.5)] = 0.3

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        # Seats, steps and supports are checked against each other where they are made.
        self.to_shaft().check_seats()
        return self

    def to_shaft(self) -> SteppedShaft:
        """Return the shaft in SI.

        Raises:
            ValueError: it cannot stand, or a bearing has no contact stiffness.
        """
        return SteppedShaft(
            tuple(step.to_step() for step in self.step),
            self.load.to_seat(),
            tuple(support.to_support() for support in self.support),
            1e9 * self.modulus_gpa,
            self.poisson,
        )


def read_shaft(path: Path) -> SteppedShaft:
    """Return the shaft in a TOML file.

    Raises:
        ConfigError: with one line for each problem: the file, the line, the key, what was found and what is allowed.
    """
    text, values = read_toml(path)
    try:
        return ShaftFile.model_validate(values).to_shaft()
    except ValidationError as error:
        raise ConfigError(sort_problems(explain_problems(error, ShaftFile), path, find_lines(text))) from None
