# %% [markdown]
# # Check my DH table
#
# A table of Denavit-Hartenberg parameters has one number wrong, or is read in the wrong convention: which? The arm is
# the UR5; its manufacturer publishes these parameters in the standard convention.

# %%
from pathlib import Path

import numpy as np

import twin

TABLE = """\
# convention: standard
joint,theta,d [mm],a [mm],alpha [deg]
shoulder_pan,q1,89.159,0,90
shoulder_lift,q2,0,-425,0
elbow,q3,0,-392.25,0
wrist_1,q4,109.15,0,90
wrist_2,q5,94.65,0,-90
wrist_3,q6,82.3,0,0
"""
Path("ur5.csv").write_text(TABLE, encoding="utf-8")
robot = twin.load("ur5.csv")
robot.forward(np.zeros(6)).round(6)


# %% [markdown]
# The same by the matrices of a textbook, at a thousand random joint values. The file is read in metres and radians.


# %%
def textbook(q):
    """Return T_base_tool (4, 4): Rz(theta) Tz(d) Tx(a) Rx(alpha) of each row."""
    T = np.eye(4)
    for line, theta in zip(TABLE.splitlines()[2:], q, strict=True):
        d, a, alpha = (float(cell) for cell in line.split(",")[2:])
        c, s = np.cos(theta), np.sin(theta)
        ca, sa = np.cos(np.radians(alpha)), np.sin(np.radians(alpha))
        row = [[c, -s * ca, s * sa, a * c / 1e3], [s, c * ca, -c * sa, a * s / 1e3], [0, sa, ca, d / 1e3], [0, 0, 0, 1]]
        T = T @ np.array(row)
    return T


qs = np.random.default_rng(1).uniform(-np.pi, np.pi, (1000, 6))
differences = robot.forward(qs) - np.array([textbook(q) for q in qs])
print(f"largest difference {np.abs(differences).max():.1e}")

# %% [markdown]
# A colleague's copy has two digits swapped. The comparison names the joint, the size, and the number to edit in
# either file.

# %%
Path("copy.csv").write_text(TABLE.replace("-392.25", "-392.52"), encoding="utf-8")
found = twin.compare("ur5.csv", "copy.csv")
found

# %% [markdown]
# The same numbers, read in the modified convention, are another robot:

# %%
Path("modified.csv").write_text(TABLE.replace("standard", "modified"), encoding="utf-8")
twin.compare("ur5.csv", "modified.csv").verdict
