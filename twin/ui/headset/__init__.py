"""Show robots in a headset: a WebXR page, the stream of poses, and the server of both."""
