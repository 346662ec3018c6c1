"""Timed motion of a protocol: exact task-space paths, TOPP-RA timing, and a check of every sample."""
