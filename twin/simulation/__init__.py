"""Simulation: an arm under a controller, an operator at the console, robots at one patient."""
