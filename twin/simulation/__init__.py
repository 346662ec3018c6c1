"""Simulation: a controlled arm, an operator at a console, several robots at one patient."""
