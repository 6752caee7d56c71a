"""A rotor on two bearings (Ceruti, master thesis, Politecnico di Torino, 2021)."""
