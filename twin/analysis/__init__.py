"""Many poses, many tolerances, many designs: what a robot reaches, how exactly, and what would be better."""
