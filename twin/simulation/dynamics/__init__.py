"""Dynamics of a robot: its masses, plants that move it under efforts, and a computed-torque controller."""
