"""Hazards, which change one signal of a World while they are active, and campaigns of sessions with them.

`fault` is the hazard, `packet_hand` and `trainee` are the simulated people, `traced_run` and `unbraked_deviation`
measure a machine, `attacked_session` is one session, `campaign` draws sessions, `campaign_log` keeps them,
`detection`, `roc` and `summary` judge them, and `trends` repeats published experiments.
"""
