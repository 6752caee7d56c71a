"""A rotor on two bearings (Ceruti, master thesis, Politecnico di Torino, 2021)."""

from models.words.extras import Model

MODEL = Model(
    "models.solve.rotor.rig:RotorRig",
    ("models.solve.rotor.solver", "models.solve.rotor.elastic"),
    (("rotor", "models.solve.rotor.elastic:warm"),),
)
