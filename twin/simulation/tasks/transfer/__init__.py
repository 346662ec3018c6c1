"""Tasks with rings to bring to pegs."""
