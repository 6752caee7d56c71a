"""Speed and angle of the shaft."""
