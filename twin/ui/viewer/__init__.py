"""The interactive page in a browser, by the library viser; the robot's behaviour is in `twin.ui.session`."""
