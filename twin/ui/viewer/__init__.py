"""The interactive twin in a browser, shown by viser. What the robot does is in `twin.ui.session`."""
