"""OBJ files, as an audit reads them: faults are named, whatever the order of the lines."""

from __future__ import annotations

import re

import pytest

from twin.exchange.audit.ledger import ReadError
from twin.exchange.audit.obj_file import read_obj

POINTS = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


@pytest.mark.parametrize("text", [f"{POINTS}f 1/1 2/2 3/3 4/4\n", f"{POINTS}f -4 -3 -2 -1\n", f"f 1 2 3 4\n{POINTS}"])
def test_a_polygon_becomes_triangles(text, tmp_path):
    path = tmp_path / "plate.obj"
    path.write_text(text)
    vertices, triangles = read_obj(path)
    assert vertices.shape == (4, 3)
    assert triangles.tolist() == [[0, 1, 2], [0, 2, 3]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("v 0 0\nv 1 0\nv 1 1\nf 1 2 1\n", "point 1 has 2 coordinates, not 3"),  # six numbers, as of two points
        (f"{POINTS}f 1 2 9\n", "a face uses point 9, but the file has 4 points"),
        (f"{POINTS}f 1 2 -5\n", "a face uses point -5, but only 4 points stand before it"),
        (f"f 0 1 2\n{POINTS}", "a face uses point 0, but the points of an OBJ are numbered from 1"),
        (f"{POINTS}f 1 2 x\n", "plate.obj cannot be read: invalid literal for int()"),
    ],
)
def test_a_fault_is_named(text, message, tmp_path):
    path = tmp_path / "plate.obj"
    path.write_text(text)
    with pytest.raises(ReadError, match=re.escape(message)):
        read_obj(path)
