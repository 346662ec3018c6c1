"""The version of twin, readable from every package."""

__version__ = "0.1.0"
