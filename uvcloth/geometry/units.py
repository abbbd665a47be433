"""Units of length in files, and gravity."""

UNITS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "inches": 0.0254, "feet": 0.3048}
"""Metres in one of each unit."""

GRAVITY = 9.81
"""Acceleration of gravity, m/s2."""

FREE_FALL = (0.0, 0.0, -GRAVITY)
"""Acceleration of a falling body, m/s2, in world axes."""
