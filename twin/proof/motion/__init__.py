"""Proofs about a motion in continuous time: limits, speeds, RCM and loops between the samples of a plan.

`taylor` is the arithmetic, `series` and `linkage` the path and the mechanism in it. `prediction` guesses the passive
joints, `closure` proves their motion; `rates` and `loop_determinant` follow from it. `quantities` is what is judged,
`motion_prover` the claims. Nothing here reaches planning, equations or a judge: a path is given as numbers.
"""
