"""V_eq by a particle filter over extent, depth and growth rate."""
