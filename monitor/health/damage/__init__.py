"""V_eq and TT by the thesis, by a particle filter or by a library of simulated lives."""
