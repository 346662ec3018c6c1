"""MCAP: a recorded motion with its signals, for viewers of robot data."""
