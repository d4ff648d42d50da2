"""A second world for checks, made without the project's models of beams, motion and errors."""
