"""Devices: each writes the state of its handle, pedals and buttons."""
