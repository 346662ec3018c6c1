"""Tasks with a procedure on organs."""
