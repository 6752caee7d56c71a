"""Transfer from forces in a machine to what a sensor or an ear gets of them."""
