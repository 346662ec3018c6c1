# %% [markdown]
# # Fit a robot to measured poses
#
# A laser tracker measured the tool of an arm at forty joint states. Which number of the URDF explains the poses? The
# frames of tracker and target are unknown; the comparison fits them.
#
# The measurement is simulated here: the second link is 1 mm longer than in the URDF, with a noise of 0.05 mm and 0.1
# mrad.

# %%
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import twin

URDF = """<robot name="arm">
  <link name="base"/><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
  <joint name="q1" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/></joint>
  <joint name="q2" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 0.3"/></joint>
  <joint name="q3" type="continuous"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/>
    <origin xyz="0.4 0 0"/></joint>
  <joint name="q4" type="continuous"><parent link="c"/><child link="d"/><axis xyz="1 0 0"/>
    <origin xyz="0.25 0 0.02"/></joint>
</robot>
"""
Path("arm.urdf").write_text(URDF, encoding="utf-8")
Path("true.urdf").write_text(URDF.replace("0.4 0 0", "0.401 0 0"), encoding="utf-8")

rng = np.random.default_rng(3)
qs = rng.uniform(-2.5, 2.5, (40, 4))
T_tracker_base = np.eye(4)
T_tracker_base[:3, :3] = Rotation.from_euler("xyz", [10, -20, 130], degrees=True).as_matrix()
T_tracker_base[:3, 3] = [1.2, -0.4, 0.9]
lines = ["q1 [deg],q2 [deg],q3 [deg],q4 [deg],x [mm],y [mm],z [mm],qw,qx,qy,qz"]
for q, T_base_tool in zip(qs, twin.load("true.urdf").forward(qs), strict=True):
    T = T_tracker_base @ T_base_tool
    p = T[:3, 3] + rng.normal(0, 5e-5, 3)
    R = Rotation.from_matrix(T[:3, :3]) * Rotation.from_rotvec(rng.normal(0, 1e-4, 3))
    x, y, z, w = R.as_quat()
    lines.append(",".join(f"{cell:.9g}" for cell in [*np.degrees(q), *(1e3 * p), w, x, y, z]))
Path("poses.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")

# %%
found = twin.compare("poses.csv", "arm.urdf")
found

# %% [markdown]
# In numbers: where the joint is, how sure that is, and the edit.

# %%
pair = found.pairs[0]
difference = pair.differences[0]
print(f"{difference.joint}: {1e3 * difference.shift:.3f} mm ± {1e3 * pair.poses.uncertainty:.3f} mm")
print(f"noise of the measurement {1e3 * pair.poses.noise[0]:.3f} mm")
for edit in difference.edits:
    print(edit.text())
