"""The door of both servers: who may come in, and how much anybody may ask. Pages and messages are the servers' own."""
