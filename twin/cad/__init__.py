"""Read CAD: convert STEP files and meshes to a `Mechanism` whose joint frames are measured on exact faces."""
