"""Identification of a rig."""
