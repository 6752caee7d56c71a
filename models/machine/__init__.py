"""The machine: bearings, their contacts and statics, shafts, rigs, and the scene that is asked."""
