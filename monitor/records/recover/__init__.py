"""Recovery of a damaged store from its pages and from the published files."""
