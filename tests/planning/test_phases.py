"""A phase type is one file: each has a place of its own, and a new one needs nothing else."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from twin.planning.protocol.phases import TABLES

ROOT = Path(__file__).parents[2]

LIFT = '''
"""lift: straight up by a height, outside the patient."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from twin.core.units import MM
from twin.planning.protocol.phase import Phase, PhaseEnd, PhaseStart
from twin.planning.protocol.phase_table import PhaseTable
from twin.planning.protocol.protocol_file import ProtocolFile
from twin.planning.protocol.protocol_state import ProtocolState
from twin.schema import Positive


class LiftTable(PhaseTable):
    """Straight up."""

    type: Literal["lift"]
    height_mm: Positive

    rank: ClassVar[int] = 90

    def advance(self, state: ProtocolState) -> None:
        state.require_no_rcm(self.type)

    def phase(self, protocol_file: ProtocolFile) -> "Lift":
        return Lift(self.name, self.height_mm * MM)


@dataclass(frozen=True)
class Lift(Phase):
    height: float
    type: ClassVar[str] = "lift"

    def end_after(self, start: PhaseStart) -> PhaseEnd:
        return PhaseEnd(start.angles, start.tip + [0, 0, self.height], start.rcm)
'''

USE = """
import json, sys
from pathlib import Path
import numpy as np
from twin.core.errors import DescriptionError
from twin.planning.phase_path import build
from twin.planning.protocol import ProtocolTable, load_protocol
from twin.schema import json_schema

path = build(load_protocol(Path(sys.argv[1])), np.eye(4))[-1]
said = ""
try:
    load_protocol(Path(sys.argv[2]))
except DescriptionError as error:
    said = str(error)
up = (path.motion(np.array([1.0])).p - path.motion(np.array([0.0])).p)[0].tolist()
print(json.dumps([path.phase.type, up, said, "LiftTable" in json_schema(ProtocolTable)["$defs"]]))
"""


def test_each_file_holds_one_type_with_a_place_of_its_own():
    files = {p.stem for p in (ROOT / "twin/planning/protocol/phases").glob("*.py")} - {"__init__"}
    assert set(TABLES) == files
    assert len({t.rank for t in TABLES.values()}) == len(TABLES)
    for name, table in TABLES.items():
        assert table.__module__.endswith(f".{name}")


@pytest.mark.slow
def test_a_new_type_is_one_new_file(tmp_path):
    """In a copy of the package: read, refused where it does not follow, in the schema, and a path."""
    leave = shutil.ignore_patterns("__pycache__", "_data", "web", "unity")
    shutil.copytree(ROOT / "twin", tmp_path / "twin", ignore=leave)
    (tmp_path / "twin/planning/protocol/phases/lift.py").write_text(LIFT, encoding="utf-8")
    text = (ROOT / "tests/data/protocols/valid.toml").read_text(encoding="utf-8")
    head, phases = text[: text.index("[[phases]]")], text[text.index("[[phases]]") :]
    limits = "[limits.lift]\n" + head.partition("[limits.positioning]\n")[2].partition("\n\n")[0] + "\n\n"
    lift = '[[phases]]\nname = "up"\ntype = "lift"\nheight_mm = 20\n'
    before, _, retraction = phases.rpartition("[[phases]]")
    orders = {"good": f"{phases}\n{lift}", "bad": f"{before}{lift}\n[[phases]]{retraction}"}
    for name, order in orders.items():
        (tmp_path / f"{name}.toml").write_text(head + limits + order, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", USE, str(tmp_path / "good.toml"), str(tmp_path / "bad.toml")],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    kind, up, said, published = json.loads(done.stdout)
    assert (kind, [round(x, 12) for x in up], published) == ("lift", [0, 0, 0.02], True)
    assert "add a retraction to depth 0 before this lift" in said
