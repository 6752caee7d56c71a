"""The casing of a machine as a plate or a box: mesh, modes, frequency responses, and its radiating surface."""
