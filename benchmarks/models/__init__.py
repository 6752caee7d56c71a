"""Benchmark of all models: cost, error, and what else could integrate them."""
