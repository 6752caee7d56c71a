"""V_eq and TT from a library of simulated lives: fit, calibration, forecasts."""
