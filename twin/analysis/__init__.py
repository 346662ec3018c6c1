"""Analysis of a robot: workspace, accuracy under tolerances, and comparison of designs."""
