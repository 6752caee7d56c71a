"""Time to the end learned from recorded runs to failure, without a map."""
