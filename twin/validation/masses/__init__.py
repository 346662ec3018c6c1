"""Check that stated masses, mass centres and inertias are physically possible, and find probable mistakes."""
