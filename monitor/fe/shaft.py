"""``spallwatch bearing --fe --shaft FILE``: stiffness k_i of a meshed shaft on its support bearings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from models.fe.meshes.shaft_mesh import ShaftMeshRule
from models.fe.shafts.shaft import ShaftModel, SteppedShaft

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
