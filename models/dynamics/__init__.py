"""Motions of trains of gears."""
