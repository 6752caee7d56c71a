"""The daemon and its configuration."""
