"""Kernels of trains of gears."""
