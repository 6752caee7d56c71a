"""The parameters of the machine that each model takes, one type and one file a model.

A model's parameters are a frozen dataclass with ``model``, the key of ``models.registry.MODULES``, and
``check_bearing``, which refuses a bearing that they cannot belong to. A new type joins ``AnyRig`` with one line.
"""

from __future__ import annotations

from models.rigs.ball_inertia import BallInertiaRig
from models.rigs.ring_impact import RingImpactRig
from models.rigs.rotor import RotorRig
from models.rigs.six_dof import Rig

AnyRig = Rig | BallInertiaRig | RingImpactRig | RotorRig
