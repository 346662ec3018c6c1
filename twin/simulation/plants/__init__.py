"""Plants: blocks that read a command and write the state of their robot or deformable after the tick."""
