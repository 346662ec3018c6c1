"""Basics for all packages: errors, findings, units, provenance, rotations, files, processes, foreign data."""
