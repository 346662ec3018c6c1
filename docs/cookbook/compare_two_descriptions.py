# %% [markdown]
# # Compare two descriptions
#
# One robot for two simulators: a URDF and an MJCF. Are they the same robot, and do their limits and masses agree?
# Both files are made here from one table; then the MJCF gets two mistakes.

# %%
import re
from pathlib import Path

import twin

Path("arm.csv").write_text(
    """\
# convention: standard
joint,theta,d [mm],a [mm],alpha [deg]
shoulder,q1,300,0,90
upper,q2,0,400,0
elbow,q3,0,350,0
wrist,q4,80,0,90
""",
    encoding="utf-8",
)
twin.new("arm.csv", out="arm")
twin.export("arm", to="urdf,mjcf", out="files")
twin.compare("files/arm.urdf", "files/arm.xml")

# %% [markdown]
# A joint is moved by 2 mm along the arm, in the MJCF alone:

# %%
text = Path("files/arm.xml").read_text(encoding="utf-8")
moved = text.replace('pos="0.35 ', 'pos="0.352 ')
assert moved != text
Path("files/moved.xml").write_text(moved, encoding="utf-8")
found = twin.compare("files/arm.urdf", "files/moved.xml")
for difference in found.pairs[0].differences:
    print(f"{difference.joint}: {1e3 * difference.shift:.3f} mm")
    for edit in difference.edits:
        print(f"  {edit.text()}")

# %% [markdown]
# A limit of another value is no other robot; limits, speeds, efforts and masses have verdicts of their own:

# %%
limited = re.sub(r'(<joint name="elbow"[^>]*)/>', r'\1 range="-90 90" limited="true"/>', text, count=1)
assert limited != text
Path("files/limited.xml").write_text(limited, encoding="utf-8")
twin.compare("files/arm.urdf", "files/limited.xml")
