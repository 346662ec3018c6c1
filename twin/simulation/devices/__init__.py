"""Devices: blocks that write the state of handles, pedals and buttons."""
