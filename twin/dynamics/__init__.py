"""Dynamics: masses and drives from a file, inverse and forward dynamics by two engines, computed torque control."""
