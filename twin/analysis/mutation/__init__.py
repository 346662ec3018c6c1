"""Mutation testing of the validator: seed faults into a correct robot, and count the faults that are caught."""
