"""Makers and checks that tests of levels share."""

from __future__ import annotations

A_TABLE = (-70.4, -63.4, -56.7, -50.5, -44.7, -39.4, -34.6, -30.2, -26.2, -22.5, -19.1, -16.1, -13.4, -10.9, -8.6, -6.6)
