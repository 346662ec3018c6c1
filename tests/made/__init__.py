"""Builders and seeded faults that several tests use: mechanisms, bundles, reports, pages."""
