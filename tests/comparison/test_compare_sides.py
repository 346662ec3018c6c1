"""Sides of `twin compare`: tables of Denavit-Hartenberg parameters, equations, measured poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import twin
from twin.cli import main
from twin.core.errors import TwinError

ROWS = ((0.3, 0.1, 90.0), (0.0, 0.4, 0.0), (0.05, 0.02, 90.0), (0.35, 0.0, -90.0))
"""d in m, a in m, alpha in degrees of the rows of a table, distal."""


def table(file: Path, *, a2: float = 0.4) -> Path:
    """Write a distal table of four hinges in mm and degrees, without its convention and units."""
    lines = ["theta,d,a,alpha"]
    for i, (d, a, alpha) in enumerate(ROWS, 1):
        length = a2 if i == 2 else a
        lines.append(f"q{i},{1e3 * d:g},{1e3 * length:g},{alpha:g}")
    file.write_text("\n".join(lines) + "\n")
    return file


def urdf(file: Path, *, a2: float = 0.4) -> Path:
    """Write the same arm as a URDF: each joint's frame is the frame after the row before."""
    lines = ['<robot name="arm">']
    lines += [f'<link name="link{i}"/>' for i in range(len(ROWS) + 1)] + ['<link name="tool"/>']
    place = "0 0 0"
    turn = 0.0
    for i, (d, a, alpha) in enumerate(ROWS, 1):
        lines.append(
            f'<joint name="q{i}" type="continuous"><parent link="link{i - 1}"/><child link="link{i}"/>'
            f'<origin xyz="{place}" rpy="{turn!r} 0 0"/><axis xyz="0 0 1"/></joint>'
        )
        place = f"{a2 if i == 2 else a:g} 0 {d:g}"
        turn = float(np.radians(alpha))
    lines.append(
        f'<joint name="end" type="fixed"><parent link="link{len(ROWS)}"/><child link="tool"/>'
        f'<origin xyz="{place}" rpy="{turn!r} 0 0"/></joint></robot>'
    )
    file.write_text("\n".join(lines))
    return file


def test_convention_and_units_of_a_table_are_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [str(table(tmp_path / "arm.csv")), str(urdf(tmp_path / "arm.urdf"))]
    assert main(["compare", *files]) == 2
    assert "--dh standard" in capsys.readouterr().err
    assert main(["compare", *files, "--dh", "standard", "--units", "mm,deg"]) == 0
    assert main(["compare", *files, "--dh", "modified", "--units", "mm,deg"]) == 1
    assert twin.compare(*files, dh="standard", units="mm,deg").pairs[0].agrees
    found = twin.compare(table(tmp_path / "b.csv", a2=0.42), files[1], dh="standard", units="mm,deg").pairs[0]
    assert [item.joint for item in found.differences] == ["q3"]
    assert found.differences[0].shift == pytest.approx(0.02, abs=1e-9)
    with pytest.raises(TwinError, match="no side is one"):
        twin.compare(files[1], files[1], dh="standard")
