"""State, timeline, readings and recorded sessions of the active robot, independent of viewer and headset."""
