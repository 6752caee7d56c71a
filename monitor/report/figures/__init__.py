"""Figures of reports: drawing, zoom, trends, spectra, maps, scenes."""
