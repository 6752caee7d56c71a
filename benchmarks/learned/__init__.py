"""Forecasts learned from recorded runs."""
