"""Units of length that files are in."""

UNITS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "inches": 0.0254, "feet": 0.3048}
"""Metres in one of each."""
