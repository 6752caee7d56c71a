"""Gears: geometry of a pair, stiffness and errors of its mesh, trains of rigid bodies with wheels."""
