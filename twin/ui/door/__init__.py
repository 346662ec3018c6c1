"""Access control and rate limits of both servers; the servers themselves define pages and messages."""
