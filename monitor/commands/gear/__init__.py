"""``spallwatch gear``: a gear train, its orders, forces and levels."""
