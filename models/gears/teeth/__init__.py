"""Teeth: their form, the stiffness of a pair in contact over a turn, and faults."""
