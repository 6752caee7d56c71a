"""Geometry of bearings and the meshes of their parts, sized by the contacts that a load makes."""
