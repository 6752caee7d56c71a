"""Run a baseline commit and the present tree over fixed cases, and compare what they say; see ``__main__``."""
