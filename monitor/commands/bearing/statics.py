"""Statics of ``spallwatch bearing``: from a contact law, and ball by ball under radial and axial load, and tilt."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.machine.ball_statics import BallStatics, RingState, equilibrium
from models.machine.bearing import Bearing, CatalogueEntry, kinematics
from models.machine.contact_estimates import estimate_stiffness
from models.machine.hertz import contact_patches, mean_bearing_stiffness
from models.machine.load_distribution import (
    StiffnessPassage,
    load_distribution,
    load_zone,
    stiffness_against_load,
    stiffness_over_passage,
)
from models.machine.rig import Rig, natural_frequencies
from models.machine.scene import Defect
from monitor.commands.common import InputError, write_plot

LOAD_STEPS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Multiples of the load at which the radial stiffness is printed."""
_STATICS = (
    "k_xx_newton_per_m",
    "k_yy_newton_per_m",
    "natural_frequencies_hz",
    "displacement_um",
    "load_zone_deg",
    "largest_element_load_newton",
    "load_distribution",
    "stiffness_over_passage",
    "stiffness_over_damaged_passage",
    "radial_stiffness",
)


def analytic_statics(
    bearing: Bearing, rig: Rig, load: float, k_c: float | None, clearance: float, defect: Defect | None
) -> dict[str, Any]:
    """Return what follows from the contact stiffness k_c; all None if it is unknown."""
    if k_c is None:
        return dict.fromkeys(_STATICS)
    mean = mean_bearing_stiffness(bearing, load, k_c, clearance=clearance)
    k_yy, k_xx = float(mean[0, 0]), float(mean[1, 1])
    shared = load_distribution(bearing, load, k_c, clearance=clearance)
    loads = [share * load for share in LOAD_STEPS]
    displacement, stiffness = stiffness_against_load(bearing, loads, k_c, clearance=clearance)
    values = (
        k_xx,
        k_yy,
        [float(f) for f in natural_frequencies(rig, k_xx, k_yy)],
        1e6 * float(shared.displacement[0]),
        math.degrees(load_zone(float(shared.displacement[0]), clearance)),
        float(shared.loads.max()),
        distribution_rows(shared.angles, shared.loads),
        passage_values(stiffness_over_passage(bearing, load, k_c, clearance=clearance)),
        defect and passage_values(stiffness_over_passage(bearing, load, k_c, clearance=clearance, defect=defect)),
        load_rows(loads, displacement, stiffness),
    )
    return dict(zip(_STATICS, values, strict=True))


def distribution_rows(angles: NDArray[np.float64], loads: NDArray[np.float64]) -> list[dict[str, float]]:
    """Return the loads of the elements, N, in the order of their angles, rad."""
    order = np.argsort(angles, kind="stable")
    return [{"angle_deg": math.degrees(angles[i]), "load_newton": float(loads[i])} for i in order]


def load_rows(
    loads: Sequence[float], displacement: NDArray[np.float64], stiffness: NDArray[np.float64]
) -> list[dict[str, float]]:
    """Return the displacement, m, (loads,), and stiffness, N/m, (loads, 2, 2), under each load, N."""
    return [
        {
            "load_newton": at,
            "displacement_um": 1e6 * float(u),
            "k_xx_newton_per_m": float(k[1, 1]),
            "k_yy_newton_per_m": float(k[0, 0]),
        }
        for at, u, k in zip(loads, displacement, stiffness, strict=True)
    ]


def passage_values(passage: StiffnessPassage) -> dict[str, float]:
    """Return the extremes of the stiffness, N/m, and the swing that they make, % of the mean."""
    low, high = passage.matrix.min(axis=0), passage.matrix.max(axis=0)
    return {
        "k_xx_least_newton_per_m": float(low[1, 1]),
        "k_xx_largest_newton_per_m": float(high[1, 1]),
        "k_xx_swing_percent": 100.0 * float(passage.swing[1]),
        "k_yy_least_newton_per_m": float(low[0, 0]),
        "k_yy_largest_newton_per_m": float(high[0, 0]),
        "k_yy_swing_percent": 100.0 * float(passage.swing[0]),
        "k_xy_largest_newton_per_m": passage.largest_coupling,
    }


def areas_known(bearing: Bearing, load: float, k_c: float, clearance: float) -> dict[str, dict[str, float]] | None:
    """Return ``_areas``, or None where a radius is unknown."""
    try:
        return _areas(bearing, load, k_c, clearance)
    except ValueError:
        return None


def _areas(bearing: Bearing, load: float, k_c: float, clearance: float) -> dict[str, dict[str, float]]:
    """Return half length and half width of the most loaded contacts, um."""
    patches = contact_patches(bearing, float(load_distribution(bearing, load, k_c, clearance=clearance).loads.max()))
    return {
        race: {"half_length": 1e6 * half_length, "half_width": 1e6 * half_width}
        for race, (half_length, half_width) in zip(("inner", "outer"), patches, strict=True)
    }


def static_lines(values: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of the statics for people."""
    yield (
        f"radial stiffness    {values['k_xx_newton_per_m'] / 1e6:.1f} MN/m across the load, "
        f"{values['k_yy_newton_per_m'] / 1e6:.1f} MN/m along it; displacement {values['displacement_um']:.2f} um"
    )
    for key, words in (("stiffness_over_passage", "healthy"), ("stiffness_over_damaged_passage", "damaged")):
        if values[key] is not None:
            yield (
                f"swing of stiffness  {values[key]['k_xx_swing_percent']:.2f} % across, "
                f"{values[key]['k_yy_swing_percent']:.3f} % along, while the elements pass ({words})"
            )
    loaded = sum(element["load_newton"] > 0.0 for element in values["load_distribution"])
    yield (
        f"load distribution   {loaded} elements within {values['load_zone_deg']:.0f} deg, "
        f"{values['largest_element_load_newton']:.0f} N on the most loaded"
    )
    for row in values["radial_stiffness"]:
        yield (
            f"  at {row['load_newton']:8g} N     {row['k_xx_newton_per_m'] / 1e6:.1f} and "
            f"{row['k_yy_newton_per_m'] / 1e6:.1f} MN/m, {row['displacement_um']:.2f} um"
        )
    if values["contact_areas_um"] is not None:
        for race, area in values["contact_areas_um"].items():
            size = f"{2 * area['half_length']:.0f} x {2 * area['half_width']:.0f} um"
            yield f"contact area        {size} on the {race} race"
    yield "natural frequencies " + ", ".join(f"{f:.1f}" for f in values["natural_frequencies_hz"]) + " Hz"


CAGE_STEPS = 24
"""Cage angles in one spacing of the balls over which means are taken."""


@dataclass(frozen=True)
class BallCase:
    """A bearing under load: its geometry, loads (N), tilt (rad), speed (Hz) and radial clearance (m).

    Attributes:
        tilt: of the inner ring in the plane of the radial load; positive where the side under the load moves against
            the axial load.
        estimated: names of the dimensions that are estimates.
    """

    statics: BallStatics
    radial: float
    axial: float
    tilt: float
    speed: float
    estimated: tuple[str, ...]

    def passage(self) -> tuple[RingState, ...]:
        """Return the states while the cage turns by one spacing of the balls; the first has a ball under the load.

        Raises:
            RuntimeError: no equilibrium was found.
        """
        load = np.array([self.radial, 0.0, self.axial, 0.0, 0.0])
        held = {"tilt_x": 0.0, "tilt_y": self.tilt}
        spacing = 2.0 * math.pi / self.statics.bearing.n_elements
        begin, found = None, []
        for step in range(CAGE_STEPS):
            angle = spacing * step / CAGE_STEPS
            state = equilibrium(self.statics, load, self.speed, cage_angle=angle, held=held, begin=begin)
            begin = state.displacement
            found.append(state)
        return tuple(found)


def ball_case(
    entry: CatalogueEntry, radial: float, axial: float, tilt: float, speed: float, clearance: float
) -> BallCase:
    """Return a case, unknown groove radii estimated; loads in N, tilt in rad, speed in Hz, radial clearance in m.

    Raises:
        InputError: the bearing is none of one row of balls with an inner ring that turns.
    """
    bearing, estimated = entry.bearing, ()
    if bearing.inner_groove_radius is None or bearing.outer_groove_radius is None:
        found = estimate_stiffness(entry)
        bearing = replace(
            bearing,
            inner_groove_radius=found.bearing.inner_groove_radius,
            outer_groove_radius=found.bearing.outer_groove_radius,
        )
        estimated = tuple(name for name in found.estimated if name.endswith("groove_radius"))
    # The play is across, twice the radial clearance; a contact angle has a play of its own.
    play = 2.0 * clearance if clearance > 0.0 or bearing.contact_angle == 0.0 else None
    try:
        return BallCase(BallStatics(bearing, play), radial, axial, tilt, speed, estimated)
    except ValueError as error:
        raise InputError(f"--statics balls: {error}") from None


def ball_values(case: BallCase, states: Sequence[RingState]) -> dict[str, Any]:
    """Return what is printed of a case; the balls are those of the first state, with one of them under the load."""
    first, bearing = states[0], case.statics.bearing
    nominal = kinematics(bearing, case.speed)
    bpfo = float(np.mean([state.bpfo for state in states]))
    ftf = float(np.mean([state.ftf for state in states]))
    touching = np.array([state.inner_force > 0.0 for state in states])
    torque = -1e3 * np.array([state.resistance_torque()[0] for state in states])
    places = 1e6 * np.array([state.displacement[:3] for state in states])
    return {
        "radial_load_newton": case.radial,
        "axial_load_newton": case.axial,
        "tilt_mrad": 1e3 * case.tilt,
        "play_um": 1e6 * case.statics.play,
        "estimated": list(case.estimated),
        "balls": [
            {
                "angle_deg": math.degrees(angle),
                "inner_load_newton": float(inner),
                "outer_load_newton": float(outer),
                "inner_contact_angle_deg": math.degrees(beta_i) if inner > 0.0 else None,
                "outer_contact_angle_deg": math.degrees(beta_o) if outer > 0.0 else None,
            }
            for angle, inner, outer, beta_i, beta_o in zip(
                first.angles, first.inner_force, first.outer_force, first.inner_angle, first.outer_angle, strict=True
            )
        ],
        "centrifugal_force_newton": float(np.mean([state.centrifugal for state in states])),
        "mean_contact_angle_deg": math.degrees(float(np.mean([state.mean_angle for state in states]))),
        "loaded_balls_least": int(touching.sum(axis=1).min()),
        "loaded_balls_most": int(touching.sum(axis=1).max()),
        "largest_load_newton": float(max(state.inner_force.max() for state in states)),
        "ftf_hz": ftf * case.speed,
        "bpfo_hz": bpfo * case.speed,
        "bpfo_order": bpfo,
        "bpfo_change_percent": 100.0 * (bpfo * case.speed / nominal.bpfo - 1.0),
        "contact_interval_turns": float(touching.mean()) / ftf,
        "displacement_um": dict(zip(("along_load", "across_load", "axial"), places.mean(axis=0).tolist(), strict=True)),
        "tilting_moment_newton_m": float(np.mean([state.load[4] for state in states])),
        "resistance_torque_newton_mm": float(np.mean(torque)),
        "resistance_torque_swing_newton_mm": float(np.ptp(torque)),
        "residual_newton": float(max(state.residual for state in states)),
    }


def ball_lines(values: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of the statics ball by ball for people."""
    yield (
        f"ball by ball        {values['radial_load_newton']:g} N radial, {values['axial_load_newton']:g} N axial, "
        f"tilt {values['tilt_mrad']:g} mrad, play {values['play_um']:.3g} um"
        + (f"; estimated: {', '.join(values['estimated'])}" if values["estimated"] else "")
    )
    yield f"  {'ball':>4}{'at, deg':>10}{'inner, N':>11}{'outer, N':>11}{'inner, deg':>12}{'outer, deg':>12}"
    for number, ball in enumerate(values["balls"], 1):
        angles = "".join(
            f"{'-' if ball[key] is None else format(ball[key], '.1f'):>12}"
            for key in ("inner_contact_angle_deg", "outer_contact_angle_deg")
        )
        loads = f"{ball['inner_load_newton']:11.1f}{ball['outer_load_newton']:11.1f}"
        yield f"  {number:4}{ball['angle_deg']:10.1f}{loads}{angles}"
    least, most = values["loaded_balls_least"], values["loaded_balls_most"]
    loaded = f"{least}" if least == most else f"{least} to {most}"
    yield (
        f"  loaded            {loaded} balls, at most {values['largest_load_newton']:.1f} N; "
        f"centrifugal force {values['centrifugal_force_newton']:.3g} N"
    )
    yield (
        f"  mean angle        {values['mean_contact_angle_deg']:.2f} deg: FTF {values['ftf_hz']:.3f} Hz, BPFO "
        f"{values['bpfo_hz']:.3f} Hz ({values['bpfo_order']:.4f} a turn), {values['bpfo_change_percent']:+.2f} %"
    )
    yield f"  contact interval  {values['contact_interval_turns']:.3f} turns of the shaft in a turn of the cage"
    yield (
        f"  ring              {values['displacement_um']['along_load']:.2f} um along the load, "
        f"{values['displacement_um']['axial']:.2f} um axial; moment {values['tilting_moment_newton_m']:.3g} N m"
    )
    yield (
        f"  resistance        {values['resistance_torque_newton_mm']:.3g} N mm, swing "
        f"{values['resistance_torque_swing_newton_mm']:.2g} N mm"
    )


def draw_balls(case: BallCase, states: Sequence[RingState], values: dict[str, Any], path: Path) -> None:
    """Draw a case as PNG, SVG or HTML; InputError where the file cannot be written."""
    from monitor.report.figures.balls import balls_sheet

    write_plot(balls_sheet(case.statics.bearing, case.speed, states, values), path)
