"""Hazards, which change one signal of a World while they are active, and campaigns of sessions with them.

`fault` is the hazard, `hand` and `trainee` are the simulated people, `attacked` is one session, `campaign` draws
sessions, `log` keeps them, `detection`, `roc` and `summary` judge them, and `trends` repeats published experiments.
"""
