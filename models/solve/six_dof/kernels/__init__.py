"""Kernels of the six-degree-of-freedom model."""
