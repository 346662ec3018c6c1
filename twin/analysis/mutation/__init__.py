"""Mutation testing of the validator: seed faults into a correct robot, and count those that validation finds."""
