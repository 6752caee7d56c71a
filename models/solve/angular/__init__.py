"""An elastic shaft on two ball bearings whose angular speed is watched (Thibault et al. 2022)."""
