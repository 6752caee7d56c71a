"""The model of a pair of gears on two shafts, one of which turns in the bearing that is looked at."""

from __future__ import annotations

from models.words.extras import Model

MODEL = Model(
    "models.gears.pair.rig:GearPairRig", ("models.gears.pair.solver",), (("gears", "models.gears.pair.solver:warm"),)
)
