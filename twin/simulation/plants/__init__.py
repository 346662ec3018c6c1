"""Plants: each takes a command and writes the state of its robot or deformable after the tick."""
