"""``spallwatch bearing --fe --shaft FILE``: a shaft in a file, and its stiffness k_i on its support bearings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, ValidationError, model_validator

from models.fe.meshes.shaft_mesh import ShaftMeshRule, Step
from models.fe.shafts.shaft import ShaftModel, ShaftSeat, ShaftSupport, SteppedShaft
from models.fe.shafts.spring import bearing_spring
from models.machine.bearing import CatalogueEntry, catalogue_entry
from models.machine.contact_estimates import estimate_stiffness
from monitor.config.explain import explain_problems
from monitor.config.fields import ConfigSection, NotNegative, Positive
from monitor.config.load import ConfigError, read_toml, sort_problems
from monitor.config.positions import find_lines

_MM = 1e-3


class StepSection(ConfigSection):
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


class ShaftSeatSection(ConfigSection):
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


class ShaftFile(ConfigSection):
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


LOAD_STEPS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Multiples of the load at which k_i is given."""
# The mesh that tells the error of the other one has cells this much longer where strains are singular. What is left to
# the limit is about twice what lies between both.
_COARSER = 2.0
_REMAINDER = 2.0


def shaft_values(shaft: SteppedShaft, load: float, rule: ShaftMeshRule | None = None) -> dict[str, Any]:
    """Return k_i of a shaft under a load, N, and about it, with the error of its mesh.

    Raises:
        MissingExtraError: scikit-fem is missing.
    """
    rule = rule or ShaftMeshRule()
    model, coarser = ShaftModel(shaft, rule), ShaftModel(shaft, replace(rule, finest=_COARSER * rule.finest))
    states = [model.solve(step * load) for step in LOAD_STEPS]
    state = model.solve(load)
    error = _REMAINDER * abs(coarser.solve(load).stiffness / state.stiffness - 1.0)
    converged = all(one.converged for one in (*states, state))
    return {
        "load_newton": load,
        "k_i_newton_per_m": state.stiffness,
        "k_i_seat_newton_per_m": state.seat_stiffness,
        "mesh_error_percent": 100.0 * error,
        "against_load": [
            {"load_newton": one.load, "k_i_newton_per_m": one.stiffness, "k_i_seat_newton_per_m": one.seat_stiffness}
            for one in states
        ],
        "reactions_newton": state.reactions.tolist(),
        "support_displacement_um": (1e6 * state.seats[:, 0]).tolist(),
        "unknowns": model.condensed.unknowns,
        "status": "converged" if converged else "not_in_equilibrium",
    }


def shaft_lines(values: dict[str, Any]) -> Iterator[str]:
    """Yield what :func:`shaft_values` found, as text."""
    yield (
        f"shaft: k_i {values['k_i_newton_per_m'] / 1e6:.4g} MN/m at its end, "
        f"{values['k_i_seat_newton_per_m'] / 1e6:.4g} MN/m at the seat of the bearing "
        f"(mesh error {values['mesh_error_percent']:.2g} %, {values['unknowns']} unknowns, {values['status']})"
    )
    steps = ", ".join(
        f"{one['load_newton']:.4g} N {one['k_i_newton_per_m'] / 1e6:.4g}" for one in values["against_load"]
    )
    yield f"  over the load: {steps} MN/m"
    forces, shifts = _joined(values["reactions_newton"]), _joined(values["support_displacement_um"])
    yield f"  support forces {forces} N, shifts {shifts} um"


def _joined(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.4g}" for value in values)
