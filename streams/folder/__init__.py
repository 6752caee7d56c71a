"""A watched folder as a live source."""
