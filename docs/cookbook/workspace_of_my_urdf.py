# %% [markdown]
# # The workspace of my URDF, as a cloud
#
# A URDF has no equations: its mechanism is sampled over the ranges of its joints.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import twin

Path("arm.urdf").write_text(
    """<robot name="arm">
  <link name="base"/><link name="column"/><link name="upper"/><link name="lower"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="column"/><axis xyz="0 0 1"/>
    <origin xyz="0 0 0.2"/><limit lower="-2.6" upper="2.6" effort="10" velocity="2"/></joint>
  <joint name="lift" type="revolute"><parent link="column"/><child link="upper"/><axis xyz="0 -1 0"/>
    <limit lower="-0.2" upper="1.8" effort="10" velocity="2"/></joint>
  <joint name="bend" type="revolute"><parent link="upper"/><child link="lower"/><axis xyz="0 -1 0"/>
    <origin xyz="0.35 0 0"/><limit lower="-2.4" upper="0" effort="10" velocity="2"/></joint>
  <link name="tip"/>
  <joint name="end" type="fixed"><parent link="lower"/><child link="tip"/><origin xyz="0.25 0 0"/></joint>
</robot>
""",
    encoding="utf-8",
)
space = twin.workspace("arm.urdf", count=200_000)
space

# %% [markdown]
# `reached` has a value for each position of a grid, `position` returns it in metres, in the frame of the base.

# %%
points = space.grid.position(np.flatnonzero(space.reached))
figure = plt.figure(figsize=(6, 4.5), layout="constrained")
axes = figure.add_subplot(projection="3d")
axes.scatter(*points.T, c=points[:, 2], s=2)
axes.set(xlabel="x in m", ylabel="y in m", zlabel="z in m")
axes.set_aspect("equal")
axes.view_init(elev=22, azim=-50)

# %% [markdown]
# For other programs: `twin workspace arm.urdf` writes the cloud as PLY (MeshLab, CloudCompare, Blender), USD, JSON
# and NumPy array.
