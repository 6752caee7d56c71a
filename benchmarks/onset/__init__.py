"""The onset of damage."""
