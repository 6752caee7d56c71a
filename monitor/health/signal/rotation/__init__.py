"""The angle of the shaft over a block: from pulses, from a speed signal, or from the vibration itself."""
