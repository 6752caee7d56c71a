"""A recording as a source that ends."""
