"""The parameters of the machine that each model takes, one type and one file a model.

A model's parameters are a frozen dataclass with ``model``, the key of ``models.solve.registry.MODULES``, ``uncertain``,
the names of those that differ from machine to machine of a kind, and ``check_bearing``, which refuses a bearing that
they cannot belong to. A new type joins ``AnyRig`` with one line.
"""

from __future__ import annotations

from typing import get_args

from models.machine.rig import Rig
from models.rigs.gear_pair import GearPairRig
from models.solve.angular.rig import AngularRig
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.ring_impact.rig import RingImpactRig
from models.solve.rotor.rig import RotorRig

AnyRig = Rig | AngularRig | BallInertiaRig | GearPairRig | RingImpactRig | RotorRig

RIGS: dict[str, type[AnyRig]] = {kind.model: kind for kind in get_args(AnyRig)}
"""The types by the model that takes them."""

IGNORES_DEPTH: dict[str, str] = {RingImpactRig.model: "its impacts follow the extent of a defect, not its depth"}
"""Models whose vibration is the same for any depth of a defect, and why: no volume can be told from it."""
