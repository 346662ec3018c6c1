"""Checks of all robot descriptions in a folder, for repositories of robots ([check](check.md)).

rules       the rules: identifier, severity, what is wrong, what to do
check_finding  a finding with rule, file, line and fingerprint
files       the descriptions in a folder; meshes and packages that they name
places      the lines of the elements of an XML file
elements    rules for the elements of a URDF, an expanded xacro or a SDF
mechanisms  rules for what was read, in any format
judge       all rules on one file
pair_comparison  which files describe one robot, and how they differ
baseline, sarif, junit      files for other programs
run         the check of a folder
"""
