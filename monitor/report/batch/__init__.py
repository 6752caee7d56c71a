"""Reports of many runs: comparison, index, summary."""
