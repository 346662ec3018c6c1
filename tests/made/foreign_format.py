"""A format in a package outside of twin, which an entry point names: the poses of the links at rest, as text."""

from __future__ import annotations

from pathlib import Path

FORMAT = """
from twin.core.foreign.budget import Budget
from twin.exchange.format import Format, FormatVariant, Holds, Places


def is_list(path):
    return path.read_bytes()[:11] == b"link poses\\n"


FORMAT = Format(
    name="poses",
    title="lists of link poses",
    places=Places(export=200, use=200, audit=200),
    variants=(FormatVariant("poses", ".poses", "lists of poses", Budget(100_000), rank=80, trust=800),),
    recognise=is_list,
    holds=Holds.LINKS | Holds.REST,
    code="poses",
    use="- Spreadsheets: each line of a .poses file is the pose of a link.",
    package=__package__,
)
"""

WRITE = """
from twin.exchange.write.home_poses import home_poses


def write(order, folder):
    mechanism = order.mechanism
    lines = ["link poses"]
    for name, T in home_poses(mechanism).items():
        lines.append(" ".join([name, *(repr(float(x)) for x in T.ravel())]))
    lines.append("end")
    (folder / f"{mechanism.name}.poses").write_text("\\n".join(lines) + "\\n", encoding="utf-8")
    return []


def files(order):
    return [(f"{order.mechanism.name}.poses", "poses of the links at rest")]
"""

AUDIT = """
import numpy as np

from twin.exchange.audit.file_content import Content
from twin.exchange.audit.ledger import ReadError


def read(path, ledger, context):
    ledger.tool, ledger.version = "link_poses", "1"
    lines = path.read_text(encoding="utf-8").split("\\n")
    if lines[0] != "link poses" or lines[-2:] != ["end", ""]:
        raise ReadError("the file has no heading, or no end")
    content = Content(ledger, "poses")
    for line in lines[1:-2]:
        name, *numbers = line.split(" ")
        content.rest[name] = np.array([float(x) for x in numbers]).reshape(4, 4)
    content.declared = tuple(content.rest)
    wrong = [n for n, T in content.rest.items() if abs(np.linalg.det(T[:3, :3]) - 1) > 1e-6]
    for name in wrong:
        ledger.wrong("poses.rotation", f"the pose of link '{name}' is not a rotation.", name)
    ledger.row("rotations", float(len(wrong)), "found", 0.0)
    return content
"""


def installed(folder: Path) -> Path:
    """Write the package with its metadata into a folder, as `pip install` does; return the folder, for `sys.path`."""
    package = folder / "link_poses"
    package.mkdir(parents=True)
    texts = {"__init__.py": "", "format.py": FORMAT, "write.py": WRITE, "audit.py": AUDIT}
    for name, text in texts.items():
        (package / name).write_text(text, encoding="utf-8")
    metadata = folder / "link_poses-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: link-poses\nVersion: 1.0\n", encoding="utf-8")
    text = "[console_scripts]\nother = other:main\n\n[twin.formats]\nposes = link_poses.format:FORMAT\n"
    (metadata / "entry_points.txt").write_text(text, encoding="utf-8")
    return folder
