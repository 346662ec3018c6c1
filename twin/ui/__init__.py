"""User interfaces: session, viewer, headset and reports, and the access control of viewer and headset."""
