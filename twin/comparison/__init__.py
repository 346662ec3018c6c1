"""Compare two or more descriptions of one robot, for `twin compare`.

    side        one description as joint lines, bodies, frames and limits at one state; its own forward kinematics
    joined      joints that one side writes as several: hinges through a point as a ball, two points as a hinge
    recut       a robot with loops as a tree that is cut at the same joints as that of the other side
    matching    which joint of one side is which joint of the other
    fit         conventions (base frame, signs, zeros) and deviating links that map one side onto the other
    invariants  what consecutive joint lines have in common, whatever conventions are chosen
    evidence    what the sides state beyond their lines: base, zeros, tools, limits, inertias
    search      the fit with the fewest conventions and the fewest deviating links
    links       robots with loops: which joint has another place on which link
    mimic       a linkage with loops against linear couplings that replace its loops
    frames      frames of both sides with the same name
    items       what a fit says about the two sides, as named conventions and differences
    range       the largest difference of the tools over the common range
    statements  the numbers of a description file with their lines, and what each number moves
    edits       the number of a file whose edit removes a difference
    properties  limits, velocities, masses, couplings
    result      verdict, findings, text, data

No module here imports a writer, an audit, a solver or the reference model: poses come from the joint lines alone.
"""
