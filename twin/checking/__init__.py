"""Checks of all robot descriptions in a folder, for repositories of robots ([check](check.md)).

rules            the rules: identifier, level, what is wrong, what to do
check_finding    a finding with rule, file, line and fingerprint
descriptions     the descriptions in a folder; meshes and packages that they name
places           the lines of the elements of an XML file
elements         rules for the elements of a URDF, an expanded xacro or a SDF
mechanisms       rules for what was read, in any format
file_verdict     all rules on one file
pair_comparison  which files describe one robot, and how they differ
checker          the check of a folder
check_result     its result; baseline, sarif, junit: files for other programs
"""
