"""Finite elements: ``spallwatch bearing --fe``, its sections and its picture."""
