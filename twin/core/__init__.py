"""Modules used by all packages: errors, findings, units, provenance, rotations, files, processes, untrusted files."""
