"""Kernels of the shaft on two bearings."""
