"""A recording of a scanner: scan, rotations, windows, identification, returns."""
