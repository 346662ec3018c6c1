"""Faults seeded into a correct robot, to see whether the validator finds them: its mutation score."""
