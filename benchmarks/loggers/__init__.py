"""Invented loggers with a known truth, and what init, replay and Python make of their files."""
