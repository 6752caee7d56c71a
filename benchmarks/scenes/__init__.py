"""Scenes, and the choice of a model."""
