"""A package for the Unity editor."""
