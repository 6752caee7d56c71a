"""Simulated vibration of a damaged bearing: geometry, contact, dynamics, maps (first floor)."""
