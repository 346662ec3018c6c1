"""OpenUSD: layers with shapes, joints, masses and one motion in each stage."""
