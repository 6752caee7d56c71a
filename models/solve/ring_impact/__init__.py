"""Impacts on rings that bend (Sassi, Badri and Thomas, JVC 13(11), 2007, 1603-1628)."""
