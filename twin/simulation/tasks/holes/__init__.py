"""Tasks with holes into which the tip of an instrument goes in order."""
