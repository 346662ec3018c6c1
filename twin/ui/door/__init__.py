"""Access control and rate limits of the viewer's and the headset's server; pages and messages are defined there."""
