"""Calibration files, the dialects of the programs that read them, and conversion between both."""
