"""A user's robot folder outside the repository: a copy of SILS with a short protocol."""

from __future__ import annotations

import shutil
from pathlib import Path

ROOT = Path(__file__).parents[2]


def folder(parent: Path) -> Path:
    """Write the folder `my_robot` to the folder `parent` and return it; its default protocol is `short`."""
    out = parent / "my_robot"
    for part in ("cad", "trajectories"):
        (out / part).mkdir(parents=True)
    shutil.copy(ROOT / "cad/sils/sils.step", out / "cad")
    text = (ROOT / "cad/sils/sils.toml").read_text(encoding="utf-8")
    (out / "cad/sils.toml").write_text(text.replace('default_protocol = "table2"', 'default_protocol = "short"'))
    shutil.copy(ROOT / "twin/robots/sils.py", out / "formula.py")
    shutil.copy(ROOT / "tests/data/short.toml", out / "trajectories")
    return out
