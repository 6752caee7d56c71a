"""RMS maps and tracking."""
