"""What people look at: the session behind a hand, the viewer, the headset, the reports, the door they share."""
