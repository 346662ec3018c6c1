"""Compare two or more descriptions of one robot, for `twin compare`.

The two sides and how they are mapped onto each other:

    side              one description as joint lines, bodies, frames and limits at one state; its own forward kinematics
    mechanism_side    the side of a mechanism
    merged_joints     joints that one side writes as several: hinges through a point as a ball, two points as a hinge
    recut             a robot with loops as a tree that is cut at the same joints as that of the other side
    screws            the joint lines of equations, from their forward function alone
    matching          which joint of one side is which joint of the other
    unknowns          conventions (base frame, signs, zeros) and deviating links that map one side onto the other
    fit_problem       the joint lines of both sides, and how the unknowns move those of the first
    line_gaps         what given unknowns leave between the lines
    refinement        the steps that make this smallest
    fit_starts        the fit from start values in closed form
    invariants        what consecutive joint lines have in common, whatever conventions are chosen
    tool_lines        what the frames of a last link and the joint lines before it have in common
    evidence          what the sides state beyond their lines: base, zeros, tools, limits, inertias
    search            the fit with the fewest conventions and the fewest deviating links
    evidence_search   the search over signs and evidence of given deviating links
    smallest_deviations, convention_sizes      how far a solution is from no change
    link_motions      the links of one robot with loops, moved onto those of the other
    common_posture    robots with loops in one posture
    differing_places  robots with loops: which joint has another place on which link
    coupled_motion    which joints follow others by couplings
    mimic             a linkage with loops against linear couplings that replace its loops
    hinge_matching    which hinge of the linkage is which of the other side
    linkage_motion    the linkage with closed loops along the stroke of its driver
    tool_path         which joints lie between base and tool, and which beside
    pose_comparison   rows of joint values and tool poses against a robot
    row_columns       which column of rows is which joint
    tool_motion       the tool at the rows, with changed signs, zeros and places of joints
    row_fit           base frame, tool frame and changes that fit the rows
    row_noise         whether what remains is noise
    fewest_changes    the fewest changes with which only noise remains

What differs:

    frame_gaps        frames of both sides with the same name
    compared_items    what a fit says about the two sides, as named conventions and differences
    largest_difference        that of the tools over the common range
    properties        limits, velocities, masses, couplings
    mapped_properties those of the first side in the terms of the second
    property_texts    values of properties as text

Which number to edit:

    statements        a number of a description file with its line, and what it moves
    file_statements   all these numbers of a file
    file_numbers      all numbers of a text, whatever they do
    edits             the number of a file whose edit removes a difference
    edit_case         what an edit must achieve
    solved_value      the value of a number with which both sides agree
    paths             paths as they are told
    changed_text      a text with other values of some numbers, read again
    edit_goal         what an edit that is found so must achieve
    number_search     the value of one number that achieves it
    rereading, attribute_edits        edits of numbers, of all numbers of one attribute
    dh_statements     the numbers of a DH table, and what each moves
    loop_edits, property_edits        edits of joints of loops, of properties
    property_differences      what differs in a property, as numbers
    xacro_lines       whether a line of a xacro states the number that an edit names

    openings, loop_gaps       by how much loops are open where they are drawn, as differences
    line_pair         one comparison of two sides by their joint lines
    pair              one comparison of two sides: by joint lines or, where one has only poses, by poses
    side_pair         what such a comparison has found
    comparison_result verdict, findings, text and data of all pairs

No module here imports a writer, an audit, a solver or the reference model: poses come from the joint lines alone.
"""
