"""Identification of the parameters of a rig from tests with known defects (thesis, sections 4.2.3 to 4.4.3)."""
