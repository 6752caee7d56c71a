"""Independent oracle of the six-degree-of-freedom model on any rig (thesis, Eqs. 32-52 and 83-89).

Shares no code with ``models``: own coordinates, statics, path, rough floor and integrator (DOP853 with steps that end
on the kinks of the path and where contacts open and close). It does not search for a periodic motion: it simulates
from rest until the level settles.
"""
