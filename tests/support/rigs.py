"""Rigs of one model where those of any may stand."""

from __future__ import annotations

from models.machine.rig import Rig, RigParameters


def six_dof(rig: RigParameters) -> Rig:
    """Return the parameters of the six-degree-of-freedom model; fail where they are those of another."""
    assert isinstance(rig, Rig)
    return rig
