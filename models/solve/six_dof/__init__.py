"""The six-degree-of-freedom model of a bearing on its rig (thesis of A. Gabrielli, Ferrara 2022)."""

from models.words.extras import Model

MODEL = Model(
    "models.machine.rig:Rig",
    ("models.solve.six_dof.periodic", "models.solve.six_dof.mean_force", "models.solve.six_dof.time_domain"),
    (
        ("many scenes at once", "models.solve.six_dof.lanes:warm"),
        ("over time", "models.solve.six_dof.time_domain:warm"),
    ),
    "models.solve.six_dof.weak_effects:WEAK",
)
