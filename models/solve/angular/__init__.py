"""An elastic shaft on two ball bearings whose angular speed is watched (Thibault et al. 2022)."""

from models.words.extras import Model

MODEL = Model(
    "models.solve.angular.rig:AngularRig",
    ("models.solve.angular.solver",),
    (("angular speed", "models.solve.angular.solver:warm"),),
)
