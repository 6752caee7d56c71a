"""A bearing whose balls have inertia (Marin, Rubio, Garcia-Prada, Reinoso, JTE 42(1), 2014)."""

from models.words.extras import Model

MODEL = Model(
    "models.solve.ball_inertia.rig:BallInertiaRig",
    ("models.solve.ball_inertia.period", "models.solve.ball_inertia.solver"),
    (("balls with inertia", "models.solve.ball_inertia.solver:warm"),),
)
