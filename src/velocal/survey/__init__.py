"""Targets and stations: the pose of the scanner and the planes in its frame."""
