"""Sources of acceleration: recordings, folders, live streams, the simulated rig."""
