"""Show robots in a headset: a WebXR page, the stream of poses, and the server for the page and the stream."""
