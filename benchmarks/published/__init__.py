"""Figures that the sources print."""
