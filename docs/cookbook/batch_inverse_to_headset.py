# %% [markdown]
# # Invert a batch of poses, and export to a headset
#
# Ten thousand poses on a circle go through the closed-form inverse of SILS, a parallel robot, in NumPy arrays.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import twin

robot = twin.load("sils")
T = robot.forward(robot.mechanism.posture("insertion"))
angles = np.linspace(0, 2 * np.pi, 10_000)
Ts = np.repeat(T[None], len(angles), axis=0)
Ts[:, 0, 3] += 0.03 * np.cos(angles)
Ts[:, 1, 3] += 0.03 * np.sin(angles)
qs = robot.inverse(Ts)  # (10000, 6) in m
print(f"forward of inverse: {np.abs(robot.forward(qs) - Ts).max():.1e}")

# %%
figure, axes = plt.subplots(figsize=(6, 3), layout="constrained")
axes.plot(np.degrees(angles), 1e3 * qs, label=robot.joints)
axes.set(xlabel="angle on the circle in deg", ylabel="carriages in mm")
axes.legend(ncols=3, fontsize=8)
axes.grid(alpha=0.3)

# %% [markdown]
# How far the circle is from a singular pose: the determinant of the Jacobian, along it.

# %%
determinants = np.array([np.linalg.det(robot.jacobian(q)) for q in qs[::500]])
print(f"between {determinants.min():.3g} and {determinants.max():.3g}")
print(f"one sign along the circle: {determinants.min() * determinants.max() > 0}")

# %% [markdown]
# A file for a headset, of a robot made here from a table; readers that share no code with the writer audit it. The
# GLB is for phones, Quest and Blender, and has the motion that `new` wrote beside the robot.

# %%
Path("arm.csv").write_text(
    """\
# convention: standard
joint,theta,d [mm],a [mm],alpha [deg]
shoulder,q1,300,0,90
upper,q2,0,400,0
elbow,q3,0,350,0
""",
    encoding="utf-8",
)
twin.new("arm.csv", out="arm")
twin.export("arm", to="glb", out="xr")
