"""Access control and rate limits for the servers of viewer and headset, which define their own pages and messages."""
