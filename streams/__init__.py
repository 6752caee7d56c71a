"""Where blocks of acceleration come from: recordings, folders, live streams, the simulated rig (second floor)."""
