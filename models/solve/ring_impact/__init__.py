"""Impacts on rings that bend (Sassi, Badri and Thomas, JVC 13(11), 2007, 1603-1628)."""

from models.words.extras import Model

MODEL = Model(
    "models.solve.ring_impact.rig:RingImpactRig",
    ("models.solve.ring_impact.solver",),
    (("impacts on rings", "models.solve.ring_impact.solver:warm"),),
)
