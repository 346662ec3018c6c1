"""Reading CAD: STEP and meshes become a `Mechanism` whose joint frames are measured on exact faces."""
