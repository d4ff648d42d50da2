"""Geometry in plain NumPy: rigid transformations, planes, patches of planes."""
