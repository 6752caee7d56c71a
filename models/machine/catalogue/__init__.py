"""Geometry of standard bearings by their designation: tables of series, rules of design, suffixes, clearances."""
