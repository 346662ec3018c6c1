"""OpenUSD: write a mechanism as a layered UsdPhysics stage, read any UsdPhysics stage, and check a stage.

    gf          conversions between numpy and the OpenUSD types Gf and Vt
    scan        bodies, joints and poses of a stage, without any checks (used by read and check)
    write       Mechanism -> layers, baked motion
    read        layers -> Mechanism, baked motion; independent of the writer
    check       faults that public validators miss, and findings of public validators; independent of the writer
    same        whether two layers are equal within tolerances for their numbers

Importing this package does not import pxr; import the module that you need.
"""
