"""Parameters of one model from those of another, where their assumptions coincide, and what the difference costs."""
