"""Explaining a disagreement: which row of which equation, why, and the smallest edit of its source that fixes it."""
