"""``spallwatch bearing``: the bearing of a machine, its rows of balls, its rings as finite elements."""
