"""Other formats, one folder each in `formats`. `read`, `write` and `audit` contain what several formats use.

None of the three uses another, neither here nor in the folder of a format.
"""
