"""Scores of forecasts as issued, beside naive forecasts."""
