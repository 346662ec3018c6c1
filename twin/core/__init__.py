"""What every room stands on: errors, findings, units, provenance, rotations, files, processes, foreign data."""
