"""The equations of the console: what the print breaks is found with its figure, and every clause finds its fault."""

from __future__ import annotations

import ast
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import twin
from twin.cli import main
from twin.core import spatial
from twin.core.errors import KinematicsError, TwinError
from twin.core.units import DEG, MM
from twin.simulation.controllers.console_equations import EQUATIONS, READINGS, console
from twin.validation import console_clauses as contract
from twin.validation import console_result
from twin.validation.console_clauses import judge


@pytest.fixture(scope="module")
def judged():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(contract, "_INCREMENTS", 300)
        return {name: {c.name: c for c in judge(console(r)).clauses} for name, r in READINGS.items()}


def failing(clauses):
    return {name for name, c in clauses.items() if not c.holds}


def test_the_reading_that_holds_keeps_every_clause(judged):
    assert not failing(judged["decoupled"])


def test_the_drift_of_ten_thousand_increments():
    clauses, path = contract._closed_loop(console())
    assert len(path) == 10_001
    assert clauses[0].value <= 1e-12 / MM
    assert clauses[1].value <= 1e-9


def test_a_conjugate_turns_about_the_hand_and_has_no_scale(judged):
    clauses = judged["conjugate"]
    assert failing(clauses) == {"turn", "scale"}
    assert clauses["turn"].value == pytest.approx(50 * np.sqrt(2))
    assert clauses["scale"].value == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("name", "value", "unit"),
    [
        ("still", 70.7107, "mm"),
        ("still.shifted", 100.0, "mm"),
        ("turn", 70.7107, "mm"),
        ("roll.direction", -151.77, "mm^2"),
        ("roll.origin", 1000.0, "mm^2"),
        ("roll.lift", 400.0, "mm^2"),
        ("force.pull", 0.94, "N"),
        ("error.blind", 70.7107, "mm"),
    ],
)
def test_a_printed_failure_has_its_figure(judged, name, value, unit):
    clause = judged["paper"][name]
    assert not clause.holds
    assert (clause.value, clause.unit) == (pytest.approx(value, rel=1e-4), unit)


def test_what_the_print_keeps(judged):
    """Mirrored positions with mirrored rotations are the printed equations in a mirror; 0.6 and 0.01 are as printed."""
    assert {"left_handed", "force.size"} == set(judged["paper"]) - failing(judged["paper"])


def test_the_shifted_origin_makes_the_two_hands_disagree(judged):
    said = judged["paper"]["roll.origin"].violation
    assert "(-400, -400) mm^2" in said
    assert "(-1400, +600) mm^2" in said
    assert "the signs disagree" in said


def test_the_printed_check_is_circular(judged):
    assert "circular" in judged["paper"]["error.blind"].violation
    assert not judged["paper"]["error.right"].holds


# -- each clause finds its fault ------------------------------------------------------------------------------------


def _stale(eq2):
    first = []

    def law(W_0, W_1, T, scale):
        first.append(T)
        return eq2(W_0, W_1, first[0], scale)

    return law


def _handed(eq2):
    """Take positions of a left-handed scene for those of a right-handed one."""
    S = np.diag([1.0, 1, -1, 1])

    def law(W_0, W_1, T, scale):
        dW = eq2(W_0, W_1, T, scale)
        dW[:3, 3] = dW[:3, 3] if np.linalg.det(T[:3, :3]) < 0 or W_1[2, 3] >= 0 else S[:3, :3] @ dW[:3, 3]
        return dW

    return law


def _changed_way(change):
    def make(eq2):
        def law(W_0, W_1, T, scale):
            dW = eq2(W_0, W_1, T, scale)
            dW[:3, 3] = change(dW[:3, 3], W_0, W_1, T, scale)
            return dW

        return law

    return make


def _turned(angle):
    def make(eq2):
        def law(W_0, W_1, T, scale):
            dW = eq2(W_0, W_1, T, scale)
            return dW @ spatial.pose(spatial.rotation_z(angle))

        return law

    return make


R_T_ONCE = EQUATIONS["eq2"].variants["paper"]
FAULTS = {
    "T on one side": ("eq2", lambda law: R_T_ONCE, {"still.shifted", "regrip", "camera.still"}),
    "no scale": ("eq2", _changed_way(lambda p, W_0, W_1, T, s: p / s), {"scale"}),
    "R_T left out of the way": ("eq2", _changed_way(lambda p, a, b, T, s: s * (b - a)[:3, 3]), {"scale", "regrip.way"}),
    "R_T inverted": ("eq2", _changed_way(lambda p, a, b, T, s: s * T[:3, :3].T @ (b - a)[:3, 3]), {"camera.way"}),
    "a place of the hand": ("eq2", _changed_way(lambda p, a, b, T, s: p + 1e-3 * b[:3, 3]), {"still", "origin"}),
    "the first camera": ("eq2", _stale, {"camera.way"}),
    "positions alone mirrored": ("eq2", _handed, {"left_handed"}),
    "a drift of 1e-9 deg": ("eq2", _turned(1e-9 * DEG), {"loop.angle"}),
    "a drift of 1 pm": ("eq2", _changed_way(lambda p, a, b, T, s: p + 1e-12), {"loop"}),
    "axes of the hand unseen": (
        "eq2",
        lambda law: lambda a, b, T, s: spatial.pose(b[:3, :3] @ a[:3, :3].T, law(a, b, T, s)[:3, 3]),
        {"turn.angle"},
    ),
    "about the origin": ("eq1", lambda law: lambda dW, P_0: dW @ P_0, {"turn"}),
    "clockwise": ("eq4", lambda law: lambda *a: [-x for x in law(*a)], {"roll.direction", "roll.angle"}),
    "one hand alone": (
        "eq4",
        lambda law: lambda p, q, d, e, n: 2 * [np.arctan2(np.cross(p, p + d) @ n, p @ (p + d))],
        {"roll.origin", "roll.lift"},
    ),
    "half": ("eq4", lambda law: lambda *a: [x / 2 for x in law(*a)], {"roll.angle", "roll.opposed"}),
    "no clip": ("eq5", lambda law: EQUATIONS["eq5"].variants["paper"], {"force.pull", "force.largest"}),
    "no number when the tool moves outwards": (
        "eq5",
        lambda law: lambda x, v: np.nan if v < 0 else law(x, v),
        {"force.pull", "force.largest"},
    ),
    "N/m": ("eq5", lambda law: lambda x, v: law(x, v) / 1000, {"force.size"}),
    "compares eq. (2)": ("eq7", lambda law: EQUATIONS["eq7"].variants["paper"], {"error.right", "error.blind"}),
    "sees nothing": ("eq7", lambda law: lambda *a: np.eye(4), {"error.blind"}),
    "counts the scale twice": (
        "eq7",
        lambda law: lambda P_0, P_1, a, b, T, s: law(P_0, P_1, a, b, T, s * s),
        {"error.right"},
    ),
}


@pytest.fixture(scope="module")
def found():
    out = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(contract, "_INCREMENTS", 200)
        for name, (equation, change, _) in FAULTS.items():
            good = console()
            bad = replace(good, laws={**good.laws, equation: change(good.laws[equation])})
            out[name] = {c.name: c for c in judge(bad).clauses}
    return out


@pytest.mark.parametrize("fault", FAULTS)
def test_a_wrong_equation_is_found_at_its_clause(fault, found):
    equation, _, wanted = FAULTS[fault]
    assert wanted <= failing(found[fault])
    group = {"eq1": {"eq1", "eq2"}, "eq2": {"eq1", "eq2"}}.get(equation, {equation})
    assert {found[fault][n].equation for n in failing(found[fault])} <= group, "no other equation is named"


def test_every_clause_finds_something(judged, found):
    bites = set().union(*map(failing, found.values()), failing(judged["paper"]))
    assert bites == set(judged["decoupled"])


def test_the_judge_shares_no_code_with_the_equations():
    def own(module):
        tree = ast.parse(Path(module.__file__).read_text(encoding="utf-8"))
        return {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.module.startswith("twin")}

    assert own(contract) == {"twin.core.progress", "twin.validation.console_result"}
    assert own(console_result) == {f"twin.core.{name}" for name in ("findings", "json_types", "quantity", "result")}


# -- the equations themselves ---------------------------------------------------------------------------------------

vectors = st.tuples(*3 * [st.floats(-1, 1)]).map(np.array)


@settings(max_examples=40, deadline=None)
@given(vectors, vectors, vectors, vectors, st.floats(0.05, 1))
def test_the_tool_goes_scaled_and_turns_unscaled(w, p, turn, way, scale):
    T, W_0 = spatial.pose(spatial.exp_so3(w), p), spatial.pose(spatial.exp_so3(p), w)
    W_1 = spatial.pose(spatial.exp_so3(turn) @ W_0[:3, :3], W_0[:3, 3] + way)
    P_0 = spatial.pose(spatial.exp_so3(way), turn)
    P_1 = console().tool(P_0, W_0, W_1, T, scale)
    assert np.allclose(P_1[:3, 3] - P_0[:3, 3], scale * T[:3, :3] @ way, atol=1e-14)
    assert np.allclose(P_1[:3, :3] @ P_0[:3, :3].T, spatial.exp_so3(T[:3, :3] @ turn), atol=1e-13)
    assert np.allclose(console().error(P_0, P_1, W_0, W_1, T, scale), np.eye(4), atol=1e-13)


def test_readings_are_noted_with_source_and_reason():
    assert set(EQUATIONS) == {"eq1", "eq2", "eq3", "eq4", "eq5", "eq7"}
    for e in EQUATIONS.values():
        assert f"({e.name.removeprefix('eq')})" in e.source
        assert len(e.variants) == 1 or set(e.reasons) == set(e.variants)


def test_unknown_names_are_told():
    with pytest.raises(KinematicsError, match="eq9"):
        console({"eq9": "paper"})
    with pytest.raises(KinematicsError, match=r"eq4.*conjugate"):
        console({"eq4": "conjugate"})
    with pytest.raises(TwinError, match="raven"):
        twin.console("raven")


# -- the command ----------------------------------------------------------------------------------------------------


def test_command(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(contract, "_INCREMENTS", 200)
    assert main(["console", "davinci", "--out", str(tmp_path / "a")]) == 0
    assert "AGREE: all 25 clauses hold (exit code 0)" in capsys.readouterr().out
    assert main(["console", "davinci", "--variant", "paper", "--json", "--out", str(tmp_path / "b")]) == 1
    data = json.loads(capsys.readouterr().out)
    assert data["schema"] == "twin/console/1"
    still = next(f for f in data["findings"] if f["code"] == "console.still")
    assert still["size"] == pytest.approx(70.7107, rel=1e-5)
    assert (still["where"], still["cause"], still["unit"]) == ("eq. (2)", "eq2 (paper)", "mm")
    assert all(f["suggestion"] for f in data["findings"])
    assert {p.name for p in (tmp_path / "b").iterdir()} == {"console.json", "console.html", "console.png"}
    assert main(["console", "davinci", "--variant", "eq4=paper", "--json", "--out", str(tmp_path / "c")]) == 1
    causes = {f["cause"] for f in json.loads(capsys.readouterr().out)["findings"]}
    assert causes == {"eq4 (paper)"}
    assert main(["console", "davinci", "--variant", "printed"]) == 2
    assert "conjugate, decoupled, paper" in capsys.readouterr().err


def _without(part):
    """Return a console whose result has no value, or is mirrored, in one part."""
    base = console()

    class Broken:
        name, title, source, variants = base.name, base.title, base.source, base.variants
        force_model, force_units, turn_unit = base.force_model, base.force_units, base.turn_unit

        def tool(self, *motion):
            P = base.tool(*motion).copy()
            if part == "pose":
                P[:] = np.nan
            if part == "handedness":
                P[:3, 2] *= -1
            return P

        def turns(self, *hands):
            right, left = base.turns(*hands)
            return right, np.nan if part == "roll" else left

        def force(self, depth, rate):
            # at the surface, where only the damping acts
            return np.nan if part == "damping" and depth < 1e-6 else base.force(depth, rate)

        def error(self, *motion):
            return base.error(*motion)

    return Broken()


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        ("roll", {"roll.direction", "roll.angle", "roll.origin", "roll.lift", "roll.opposed"}),
        ("damping", {"force.size"}),
        ("pose", {"still", "turn", "turn.angle", "loop", "loop.angle", "left_handed"}),
        ("handedness", {"turn.angle"}),
    ],
)
def test_no_clause_holds_for_what_has_no_value(monkeypatch, part, expected):
    """The second of two numbers was lost by `max`, and a pose without a rotation ended in an error of SciPy."""
    monkeypatch.setattr(contract, "_INCREMENTS", 10)
    clauses = {clause.name: clause for clause in judge(_without(part)).clauses}
    assert expected <= failing(clauses)
