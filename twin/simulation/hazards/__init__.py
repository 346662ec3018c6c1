"""Hazards: each changes one signal of a World when triggered."""
