"""Time left: to a threshold of V_eq (TT), and to the alarm level (TTA)."""
