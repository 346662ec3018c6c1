"""Hazards: blocks that change one signal of a World or of a machine while they are active; campaigns use them."""
