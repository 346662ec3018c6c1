"""Dynamics of a robot: plants driven by efforts, and a computed-torque controller."""
