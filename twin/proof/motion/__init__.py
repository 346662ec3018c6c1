"""Proofs about a motion in continuous time: limits, speeds, RCM and loops between the samples of a plan.

`taylor` is the arithmetic, `series` and `linkage` the path and the mechanism in it, `closure` the loops, `quantities`
what is judged, `prove` the claims. Nothing here reaches planning, equations or a judge: a path is given as numbers.
"""
