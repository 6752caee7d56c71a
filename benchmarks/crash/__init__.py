"""Every state that a crash may leave of a short life, built from a record of its calls and opened."""
