"""A machine: a robot with motors, control software and network, which runs as a separate process."""
