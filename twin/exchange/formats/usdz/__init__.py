"""USDZ: one flattened stage in an archive, for AR Quick Look."""
