"""Tracks: joint values and link poses at keys, as JSON and as CSV."""
