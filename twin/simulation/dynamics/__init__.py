"""Dynamics of a robot: masses, plants driven by efforts, and a computed-torque controller."""
