"""The catalogue of bearings."""
