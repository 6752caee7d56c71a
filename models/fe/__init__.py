"""Stiffness of rolling bearings from finite elements, on meshes that follow the load; needs the extra ``fe``."""
