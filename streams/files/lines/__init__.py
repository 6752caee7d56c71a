"""Texts of numbers: their heads, their rows, their dates."""
