"""URDF: a tree of joints; a YAML file beside it closes loops."""
