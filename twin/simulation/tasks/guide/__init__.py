"""Tasks with a ring to guide along a wire."""
