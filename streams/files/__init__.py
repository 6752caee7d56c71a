"""Recordings in files: opened, recognised, parsed, made samples of."""
