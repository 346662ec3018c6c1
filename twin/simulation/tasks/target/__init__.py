"""Tasks with targets to touch."""
