"""What a repair reads like when it is printed, and hints for what cannot even be judged."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

from twin.core.errors import KinematicsError
from twin.robots import load_formula
from twin.validation.explain.edit_tidying import tidy
from twin.validation.explain.explain import explain
from twin.validation.explain.function_source import Source
from twin.validation.explain.judged_states import sampled_values

pytestmark = pytest.mark.usefixtures("sampled_once")


def nested(x):
    def twice(y):
        return 2 * y

    return twice(x)


def branched(x):
    if x is None:
        return 0
    return x


@pytest.mark.parametrize(
    ("function", "why"),
    [
        (nested, "the function defines twice() inside"),
        (branched, "the function returns from within a branch or a loop"),
    ],
)
def test_a_function_that_is_not_judged_is_told_why(function, why):
    source = Source(function)
    assert not source.can_be_split
    assert source.why_not_split.startswith(why)


TIDY = (
    ("x = a - -rb**2", "-rb", "x = a + rb**2"),
    ("x = a + -b * c", "-b", "x = a - b * c"),
    ("x = 2 - -1", "-1", "x = 2 + 1"),
    ("x = --b", "--b", "x = b"),
    ("x = l_p**1 * c", "1", "x = l_p * c"),
    ("x = 1 * c + d", "1", "x = c + d"),
    ("x = a / 1", "1", "x = a"),
    ("x = (R).T @ v", "(R)", "x = R.T @ v"),
    ("return (x) + y", "(x)", "return x + y"),
    ("x = f(a)", "(a)", "x = f(a)"),
    ("x = -(-a * b)", "-(-a", "x = -(-a * b)"),
    ("x = é - -b", "-b", "x = é + b"),
    ("x = a -* b", "-*", "x = a -* b"),
    ("x = b**1 + cccccccc * dddd", "dddd", "x = b**1 + cccccccc * dddd"),  # not where it was edited: the author's own
)


@pytest.mark.parametrize(("text", "edited", "want"), TIDY)
def test_an_edited_line_is_written_as_a_person_would(text, edited, want):
    start = text.encode().index(edited.encode())
    assert tidy(text.encode(), [(start, start + len(edited.encode()))]).decode() == want


@pytest.fixture(scope="module")
def sils_text():
    return inspect.getsource(inspect.getmodule(load_formula("sils").equations[0].variants["corrected"]))


@pytest.fixture(scope="module")
def reference(sils_model):
    return sampled_values(load_formula("sils"), sils_model)


@pytest.mark.slow
def test_two_edits_are_one_diff_of_finished_lines(sils_text, sils_model, reference, tmp_path):
    head, rest = sils_text.split("def eq1_corrected", 1)
    right = "Z_S1 = Z_E - sqrt(3) / 6 * l_p * s_theta - l_p / 2 * s_phi * c_theta"
    wrong = "Z_S1 = Z_E - sqrt(3) / 3 * l_p * s_theta + l_p / 2 * s_phi * c_theta"
    assert right in rest
    path = tmp_path / "formula.py"
    path.write_text(f"{head}def eq1_corrected{rest.replace(right, wrong)}", encoding="utf-8")
    x = explain("sils", load_formula(path, trial=True), sils_model, reference=reference)
    reading = x.repairs[0].cures[0][0]
    assert len(reading.changes) == 2
    assert {c.after for c in reading.changes} == {f"{right}  # (1)"}
    body = [line for line in reading.diff.splitlines() if line[:3] not in ("---", "+++")]
    assert len(body) == 3
    assert body[0].startswith("@@")
    assert body[1:] == [f"-    {wrong}  # (1)", f"+    {right}  # (1)"]
    assert x.repairs[0].seconds > 0


@pytest.mark.slow
def test_a_symbol_that_nobody_values_is_found_with_what_is_meant(sils_text, sils_model, tmp_path):
    """As the paper has it: equation (2) reads L_H, equation (3) values L_B."""
    path = tmp_path / "formula.py"
    path.write_text(sils_text.replace('            "L_H",\n', '            "L_B",\n'), encoding="utf-8")
    formula = load_formula(path, trial=True)
    x = explain("sils", formula, sils_model)
    assert (x.verdict, x.exit_code) == ("unchecked", 2)
    (finding,) = (f for f in x.invariants if f.code == "formula.unvalued")
    assert "uses 'L_H'" in finding.message
    assert "L_B = 612 mm" in finding.suggestion
    assert "that uses L_B agrees" in finding.suggestion
    from twin.kinematics import compile_formula

    with pytest.raises(
        KinematicsError, match="is 'L_H' a misspelling of 'L_B'"
    ):  # and not the L_V that is read already
        compile_formula(formula)


PLAIN = """
import numpy as np
from twin.formula import mm
PARAMETERS = {"a": mm(100), "b_1": mm(50)}


def inverse(pose, a, b_1):
    J = np.array([[pose[i, j] * (1 + i + j) + a for j in range(2)] for i in range(3)])
    q = np.linalg.inv(J) @ pose[:3, 3]
    return q[0], q[1] * b_1
"""


def test_the_inverse_of_a_matrix_that_is_not_square_says_what_to_write(tmp_path):
    from twin.kinematics import compile_formula

    def load(text):
        path = tmp_path / f"formula{len(list(tmp_path.iterdir()))}.py"
        path.write_text(text, encoding="utf-8")
        return load_formula(path, "x", lambda: ([("q1", False), ("q2", False)], np.eye(4), None), trial=True)

    with pytest.raises(KinematicsError, match=r"a 3 × 2 matrix has no inverse.*inv\(J.T @ J\) @ J.T"):
        load(PLAIN)
    q = compile_formula(load(PLAIN.replace(".inv(", ".pinv("))).inverse(np.eye(4))
    assert np.isfinite(q).all()
    with pytest.raises(KinematicsError, match="'b_1' has a value but is never used: is 'b' a misspelling of 'b_1'"):
        load(PLAIN.replace("(pose, a, b_1)", "(pose, a, b)"))


def test_a_joint_named_twice_is_told_with_both_places(sils_text, tmp_path):
    path = tmp_path / "formula.py"
    path.write_text(sils_text.replace('ActiveJoint(f"q{i}"', 'ActiveJoint(f"q{min(i, 5)}"'), encoding="utf-8")
    with pytest.raises(KinematicsError, match="two joint entries are named 'q5', number 5 and number 6"):
        load_formula(path, trial=True)
