"""Layers are the same if they differ by rounding only: 1e-9 m, 1e-9 rad, with angles of hinges in degrees."""

from __future__ import annotations

import pytest

from twin.usd.same import same_layer

LAYER = """#usda 1.0
def Xform "a"
{
    double state:angular:physics:position.timeSamples = {
        0: ANGLE,
    }
    double state:linear:physics:position = LENGTH
    string word = "WORD"
}
"""


@pytest.mark.parametrize(
    ("angle", "length", "word", "same"),
    [
        (0, 0, "x", True),
        (5e-8, 0, "x", True),
        (7e-8, 0, "x", False),
        (0, 9e-10, "x", True),
        (0, 5e-8, "x", False),
        (0, 0, "y", False),
    ],
)
def test_rounding_is_no_difference_and_all_else_is_one(tmp_path, angle, length, word, same):
    paths = [tmp_path / "a.usda", tmp_path / "b.usda"]
    for path, (q, x, w) in zip(paths, ((1e-6, 1e-6, "x"), (1e-6 + angle, 1e-6 + length, word)), strict=True):
        path.write_text(LAYER.replace("ANGLE", f"{q:.17g}").replace("LENGTH", f"{x:.17g}").replace("WORD", w))
    assert same_layer(*paths) is same
