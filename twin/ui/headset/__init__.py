"""The robot in a headset: a WebXR page, the stream that moves it, and the server of both."""
