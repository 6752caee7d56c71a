"""Parameters of the machine of a train of gears."""
