"""The interactive page in a browser, built with the library viser; `twin.ui.session` holds the robot's state."""
