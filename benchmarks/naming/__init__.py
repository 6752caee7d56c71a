"""Names of faults."""
