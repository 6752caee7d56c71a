"""Turns of a shaft: pulses, tachos, blocks by revolutions."""
