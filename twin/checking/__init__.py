"""Checks of all robot descriptions in a folder, for repositories of robots ([check](check.md)).

rules            the rules: identifier, level, what is wrong, what to do
check_finding    a finding with rule, file, line and fingerprint
descriptions     the descriptions and packages in a folder; mesh_search: the meshes that they name
places           the lines of the elements of an XML file; element_places: also of what a xacro made
elements         rules for the elements of a URDF, an expanded xacro or a SDF; mesh_findings: for their meshes
mechanisms       rules for what was read, in any format; import_findings: with what import and audit say of it
file_verdict     all rules on one file; judge_job, error_messages: what it needs
pair_comparison  which files describe one robot, and how they differ
checker          the check of a folder; workers: its processes
check_result     its result; baseline, sarif, junit: files for other programs
"""
