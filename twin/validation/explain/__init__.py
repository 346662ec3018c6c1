"""Explain a disagreement: locate the wrong row of an equation, and find the smallest source edit that fixes it."""
