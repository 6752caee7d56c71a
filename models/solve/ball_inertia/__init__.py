"""A bearing whose balls have inertia (Marin, Rubio, Garcia-Prada, Reinoso, JTE 42(1), 2014)."""
