"""Point clouds: a calibration applied to a recording, and the files that viewers read."""
