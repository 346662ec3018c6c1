"""Modules for all packages: errors, findings, units, provenance, rotations, files, processes, foreign files."""
