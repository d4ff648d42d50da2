"""Adjustment of a laser's parameters: functional and stochastic model, solvers, result."""
