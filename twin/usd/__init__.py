"""OpenUSD: write a mechanism as a layered UsdPhysics stage, read any such stage back, and check one.

    gf          the only place where numpy meets Gf and Vt
    scan    uninterpreted content of a stage: bodies, joints, poses (shared by read and check)
    write       Mechanism -> layers, baked motion
    read        layers -> Mechanism, baked motion; never trusts the writer
    check   faults that public validators miss, and those validators themselves; never trusts the writer

Importing this package does not import pxr; import the module that you need.
"""
