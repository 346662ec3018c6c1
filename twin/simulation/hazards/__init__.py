"""Hazards: each changes one signal of a World while it is active."""
