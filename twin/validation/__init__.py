"""Validation: compare the equations with the mechanism, the mechanism with its USD stage, the motion with its RCM."""
