"""Tasks with a camera to align with a rectangle."""
