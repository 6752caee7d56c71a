"""Speed and error of the engine."""
