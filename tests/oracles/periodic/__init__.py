"""Tests of the periodic oracle (reference/periodic) and of what judges the engine by it."""
