"""The page of a fleet: machines and their recordings, the worst first."""
