"""Several robots at work around one patient: where they stand, what they do, whether they meet.

load      scene.toml
play      all motions at once, distances between the robots and to what stands around
stage     one USD stage that references the robots' own
"""
