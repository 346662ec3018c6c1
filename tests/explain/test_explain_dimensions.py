"""A dimension of the CAD that changed consistently: the number is named with its value, and no edit is offered.

`TWIN_DIMENSIONS=all pytest -m slow tests/explain/test_explain_dimensions.py` redraws the STEP of three robots with each
of their lengths changed; the short form redraws one.
"""

from __future__ import annotations

import os
import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import twin
from made.drawing import draw
from twin.analysis.mutation.cad import drawn_anew
from twin.cad import frames
from twin.core.units import MM
from twin.reference import ReferenceModel
from twin.validation.explain.explain import ExplainOptions, explain
from twin.validation.explain.explanation_data import ChangedParameter, FittedParameters
from twin.validation.explain.possible_fixes import simplest_explanation
from twin.validation.explain.repair_search import GroupResult

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Changed:
    """A length of a drawing, and the parameters of the equations that it is; `typed` is what the description types."""

    robot: str
    name: str
    parameters: frozenset[str]
    together: bool = False
    typed: tuple[tuple[str, str], ...] = ()


def _same(robot: str, *names: str, **other: str) -> list[Changed]:
    pairs = {**{n: n for n in names}, **other}
    return [Changed(robot, n, frozenset(p.split())) for n, p in pairs.items()]


LENGTHS = [
    *_same("sils", l0="l_0", l1="l_1", l2="l_2", lp="l_p", LH="L_H", LV="L_V"),
    # only the difference of the two radii enters the equations
    *_same("sher", base_radius="r_b r_p", platform_radius="r_b r_p", rod_length="l"),
    *_same("sher", "d1", "d2", "d3", "AB", "BC", "CD", "DA", "AQ", "QR", "x_max", "y_AR", "DP"),
    Changed("lapbot", "arm", frozenset("ab"), together=True),
    *_same("lapbot", length="r7"),
    Changed("lapbot", "tool", frozenset({"r10"}), typed=(("[400, 0, 130]", "[400, 0, {130 - d}]"),)),
    Changed(
        "lapbot",
        "trocar",
        frozenset({"trocar_x"}),
        typed=(("[400, 0, 300]", "[{400 + d}, 0, 300]"), ("[400, 0, 130]", "[{400 + d}, 0, 130]")),
    ),
]
SHORT = [c for c in LENGTHS if c.name == "length"]


def _redrawn(case: Changed, delta: float, folder: Path) -> twin.Robot:
    """Return the robot drawn anew with one length longer by delta, in mm."""
    source = ROOT / "cad" / case.robot
    (folder / "cad").mkdir()
    text = (source / f"{case.robot}.toml").read_text(encoding="utf-8")
    for old, new in case.typed:
        values = re.sub(r"\{(\d+) ([+-]) d\}", lambda m: repr(float(m[1]) + delta * (1 if m[2] == "+" else -1)), new)
        assert old in text
        text = text.replace(f"position_mm = {old}", f"position_mm = {values}")
    (folder / f"cad/{case.robot}.toml").write_text(text, encoding="utf-8")
    shutil.copy(ROOT / f"twin/robots/{case.robot}.py", folder / "formula.py")
    nominal = (source / "dimensions.toml").read_text(encoding="utf-8")
    pattern = rf"(?m)^({re.escape(case.name)} = {{value = \[?)([-\d.]+)"
    changed, count = re.subn(pattern, lambda m: f"{m[1]}{float(m[2]) + delta!r}", nominal)
    assert count == 1
    (folder / "dimensions.toml").write_text(changed, encoding="utf-8")
    out = folder / f"cad/{case.robot}.step"
    draw(source / "model.py", "--dimensions", folder / "dimensions.toml", "--out", out)
    return twin.load(folder)


@pytest.mark.slow
@pytest.mark.parametrize("case", LENGTHS if os.environ.get("TWIN_DIMENSIONS") else SHORT, ids=lambda c: c.name)
def test_a_length_that_was_redrawn_is_named(case, tmp_path):
    rng = np.random.default_rng(sum(map(ord, case.robot + case.name)))
    delta = round(float(rng.uniform(0.05, 0.5) * rng.choice([-1, 1])), 3)
    robot = _redrawn(case, delta, tmp_path)
    x = explain(robot.name, robot.formula, robot.reference(), cad=robot.cad)
    assert (x.lead, x.explained, x.repairs, x.drawing) == ("numbers", True, (), ())
    found = x.identified
    assert {m.name for m in found.moved} == case.parameters
    assert found.alternatives == (len(case.parameters) > 1 and not case.together)
    for m in found.moved:
        assert abs(m.fitted - m.formula) == pytest.approx(abs(delta), abs=max(1e-6, 6 * m.sigma))
    assert np.isfinite(found.covariance).all()


@pytest.mark.nightly
def test_bars_that_are_all_longer_are_a_number_and_no_edit():
    """The three bars of SILS 0.3 mm longer, the mechanism made anew: no edit of eq. (2), but l_2."""
    robot = twin.load("sils")
    faces = dict(robot.cad.measured)
    for bar in ("bar1", "bar2", "bar3"):
        own = faces[bar]
        along = own["ball"].face.point - own["apex_bore"].face.point
        p = 0.3 * MM * along / np.linalg.norm(along)
        faces[bar] = {**own, "ball": _moved(own["ball"], p), "neck": _moved(own["neck"], p)}
    mechanism = drawn_anew(frames.moved(robot.mechanism, robot.cad.description, faces))
    x = explain("sils", robot.formula, ReferenceModel(mechanism), options=ExplainOptions(budget=2.0))
    assert (x.lead, x.explained, x.repairs) == ("numbers", True, ())
    (moved,) = x.identified.moved
    assert moved.name == "l_2"
    assert moved.fitted == pytest.approx(392.3, abs=1e-6)


def _moved(m, p):
    from dataclasses import replace

    return replace(m, face=replace(m.face, point=m.face.point + p))


def _numbers(*notes: str, alternatives: bool = False, exact: bool = True) -> FittedParameters:
    moved = tuple(ChangedParameter(f"p{i}", "mm", 1.0, 2.0, 0.1, note) for i, note in enumerate(notes))
    return FittedParameters(exact, 9.0, 0.0, moved, alternatives, (), (), ())


def _edits(*counts: int) -> list[GroupResult]:
    return [GroupResult([], [[SimpleNamespace(edits=[None] * n)]], None, 0.0, 1.0, 1) for n in counts]


@pytest.mark.parametrize(
    ("found", "lost", "numbers", "lead"),
    [
        (_edits(1), [], None, "edits"),
        (_edits(1), [], _numbers(exact=False), "edits"),
        (_edits(1), [], _numbers(""), "edits or numbers"),
        (_edits(1), [], _numbers("", "", alternatives=True), "edits or numbers"),
        (_edits(1, 1), [], _numbers(""), "numbers"),
        (_edits(2), [], _numbers(""), "numbers"),
        (_edits(2), [], _numbers("the value of q"), "edits or numbers"),
        (_edits(1), [], _numbers("", ""), "edits"),
        ([], [("eq", 0, 0)], _numbers(""), "numbers"),
        (_edits(1), [("eq", 0, 0)], None, ""),
        ([], [], None, ""),
    ],
)
def test_the_simpler_explanation_leads_and_a_tie_names_both(found, lost, numbers, lead):
    assert simplest_explanation(found, lost, numbers) == lead
