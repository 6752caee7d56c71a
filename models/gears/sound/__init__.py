"""Radiated sound: boundary elements, acoustic transfer vectors, third-octave bands, weighting, WAV files.

Phasors rotate as exp(+i omega t), which is what numpy's FFT of a record gives. SI units; levels in dB re 20 uPa.
"""
