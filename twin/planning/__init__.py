"""Plan the timed motion of a protocol: exact tool paths, time-optimal timing, and a check of every sample."""
