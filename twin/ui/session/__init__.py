"""The active robot, independent of viewer and headset: its state (desk), timeline, readings, recorded sessions."""
