"""Proofs that equations and mechanism agree at all poses: exact arithmetic instead of samples with a tolerance.

The operations of a formula, and those of the mechanism, are repeated with exact numbers instead of rounded ones. What
is zero there at random states is zero at all states, with odds that are computed. The two sides share only the numbers:
the formula's side repeats the operations of the compiled equations, the mechanism's side places bodies by their joints.
"""
