"""Elements, rings and cages put together: stiffness of bearings from condensed bodies."""
