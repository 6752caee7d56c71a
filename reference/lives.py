"""Blocks of simulated lives, as the stages behind the features take them."""

from __future__ import annotations

from typing import Any

from monitor.health.size import DamageInput


def block_of(life: Any, k: int) -> DamageInput:
    """Return what one block of a life says; its true V_eq stands for a tracked one."""
    return DamageInput(
        time=float(life.t[k]),
        rms=float(life.rms[k]),
        harmonics=tuple(life.harmonics[k].tolist()),
        load=float(life.load[k]),
        speed=float(life.speed[k]),
        v_eq=float(life.v_eq[k]),
    )
