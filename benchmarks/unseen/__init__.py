"""Lives that the forecaster was not made with."""
