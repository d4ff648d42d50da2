"""Adjustment of a surveyor's raw observations to coordinates of targets (optional)."""
