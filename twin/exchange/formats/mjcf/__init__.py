"""MJCF, the format of MuJoCo: a tree of joints, with equality constraints that close loops."""
