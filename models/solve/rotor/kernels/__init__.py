"""Kernels of the rotor on two bearings."""
