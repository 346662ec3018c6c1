"""The active robot, for whatever shows it: desk, timeline, instruments, sessions. Knows no viewer and no headset."""
