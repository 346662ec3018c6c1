"""Formula files that break the contract, and the sentence that each of them gets."""

from dataclasses import replace

import casadi
import numpy as np
import pytest

from twin.core.errors import KinematicsError
from twin.kinematics import ActiveJoint, Aspect, Equation, check_formula, compile_formula
from twin.robots import load_formula

USER = '''
"""A user's formula: two sliders that carry a stage in x and y."""
import casadi as ca
from twin.kinematics import ActiveJoint, Coordinates, Equation, Formula, symbolic
from twin.core.provenance import Parameter


def eq1(x, y, gain):
    q1 = x / gain
    q2 = {row}
    return q1, q2


FORMULA = Formula(
    name="stage",
    title="xy stage",
    source="own",
    parameters=(Parameter("gain", {gain}, "1", 2.0, "ASSUMED", "an example"),),
    joints=(ActiveJoint("q1", "prismatic"), ActiveJoint("q2", "prismatic")),
    coordinates=Coordinates(
        ("x", "y"), ("m", "m"),
        lambda x, y: symbolic.pose(ca.SX.eye(3), ca.vertcat(x, y, 0)),
        lambda T: (T[0, 3], T[1, 3]),
    ),
    equations=(Equation("eq1", "sliders", "own", "inverse", ("q1", "q2"), {{"own": eq1}}, {{}}, "own"),),
    characteristic_length=lambda: 0.1,
)
'''


def write(folder, row="y / gain + q1", gain="2.0", name="formula.py"):
    path = folder / name
    path.write_text(USER.format(row=row, gain=gain), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def sils():
    return load_formula("sils")


def test_users_formula_loads_like_a_built_in_one(tmp_path):
    write(tmp_path)
    for where in (tmp_path, tmp_path / "formula.py"):
        kin = compile_formula(load_formula(where))
        T = np.eye(4)
        T[:2, 3] = 0.2, 0.1
        np.testing.assert_allclose(kin.inverse(T), [0.1, 0.15])
        assert kin.joints == ("q1", "q2")
    # Two joints cannot give any pose: the left inverse says so instead of dropping the rest.
    T[2, 3] = 0.1
    with pytest.raises(
        KinematicsError, match=r"no values of x, y give this pose \(norm of the difference .* 0\.1, limit 1e-06\)"
    ):
        kin.inverse(T)
    assert np.isnan(kin.inverse_many(T[None])).all()


def test_edited_file_is_read_again(tmp_path):
    T = np.eye(4)
    T[1, 3] = 1.0
    assert compile_formula(load_formula(write(tmp_path))).inverse(T)[1] == 0.5
    assert compile_formula(load_formula(write(tmp_path, row="3 * y"))).inverse(T)[1] == 3.0


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("y / lain", r"fails at .*formula\.py:10: name 'lain' is not defined"),
        ("ca.nothing(y)", r"fails at .*formula\.py:10: "),
        ("ca.vertcat(y, y)", r"joint 'q2' has shape \(2, 1\), not \(1, 1\)"),
    ],
)
def test_broken_row_is_located(tmp_path, row, message):
    with pytest.raises(KinematicsError, match=message):
        compile_formula(load_formula(write(tmp_path, row=row)))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("import casadi\n\nx = = 1\n", r"formula\.py:3: SyntaxError"),
        ("import casadi\n\n\nraise ValueError('oh')\n", r"formula\.py:4: ValueError: oh"),
        ("x = 1\n", "defines no FORMULA"),
        ("FORMULA = 3\n", "must be a twin.kinematics.Formula, not int"),
    ],
)
def test_file_that_cannot_be_loaded(tmp_path, text, message):
    (tmp_path / "formula.py").write_text(text, encoding="utf-8")
    with pytest.raises(KinematicsError, match=message):
        load_formula(tmp_path)


def test_missing_file_lists_what_exists(tmp_path):
    with pytest.raises(KinematicsError, match=r"no formula 'silz'. Did you mean 'sils'"):
        load_formula("silz")
    with pytest.raises(KinematicsError, match="no formula"):
        load_formula(tmp_path)
    (tmp_path / "notes.txt").write_text("x")
    with pytest.raises(KinematicsError, match=r"must end in \.py"):
        load_formula(tmp_path / "notes.txt")


def test_nan_parameter(tmp_path):
    with pytest.raises(KinematicsError, match=r"formula\.py: .*parameter 'gain' is nan"):
        load_formula(write(tmp_path, gain="float('nan')"))


def changed(formula, equation, **values):
    return replace(
        formula, equations=tuple(replace(e, **values) if e.name == equation else e for e in formula.equations)
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: replace(f, joints=()), "has no active joint"),
        (lambda f: replace(f, joints=(*f.joints, f.joints[0])), "two joint entries are named 'q1'"),
        (lambda f: replace(f, joints=(ActiveJoint("Q-1", "prismatic"),)), "not an identifier"),
        (lambda f: replace(f, joints=(ActiveJoint("q1", "screw"),)), "prismatic or revolute"),
        (lambda f: replace(f, equations=()), "no inverse and no forward"),
        (lambda f: changed(f, "eq1", default="nope"), "default variant 'nope'"),
        (lambda f: changed(f, "eq1", reasons={}), "has no reason"),
        (lambda f: changed(f, "eq1", stage="sideways"), "not one of inverse, forward, helper"),
        (lambda f: changed(f, "eq1", outputs=()), "has no outputs"),
        (lambda f: changed(f, "eq1", variants={"corrected": 3}), "is not a function"),
        (lambda f: replace(f, aspects=(Aspect("D", 2, "x"),)), "must be \\+1 or -1"),
        (lambda f: replace(f, seeds=((1.0,),)), "seed 0 must have 6 finite numbers"),
        (lambda f: replace(f, coordinates=replace(f.coordinates, units=("mm",) * 6)), "'m' or 'rad'"),
        (lambda f: replace(f, parameters=(replace(f.parameters[0], note=""),)), "has no note"),
        (lambda f: replace(f, measures=(replace(f.measures[0], alarm=-1.0),)), "must not be negative"),
    ],
)
def test_broken_contract_is_named(sils, change, message):
    with pytest.raises(KinematicsError, match=message):
        check_formula(change(sils))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda f: replace(f, joints=(*f.joints, ActiveJoint("q7", "prismatic"))),
            "no equation gives joint 'q7'",
        ),
        (lambda f: replace(f, parameters=f.parameters[1:]), "'eq2' needs symbol 'l_0'. Did you mean"),
        (lambda f: replace(f, points={"s1": ("X_S1", "nope", "Z_S1")}), "gives point 's1': 'nope'"),
        (lambda f: replace(f, points={"s1": "nope"}), "point 's1': there is no symbol 'nope'"),
        (lambda f: replace(f, points={"s1": "X_S1"}), "must have 3 numbers"),
        (lambda f: replace(f, passive=("nope",)), "no equation gives passive 'nope'"),
        (
            lambda f: changed(f, "eq1", outputs=f.equations[0].outputs[:8]),
            "'eq1' returns 9 values for 8 outputs",
        ),
        (
            lambda f: replace(f, coordinates=replace(f.coordinates, from_pose=lambda T: (T[0, 3],))),
            "must return 6 values",
        ),
        (
            lambda f: replace(f, coordinates=replace(f.coordinates, from_pose=lambda T: casadi.inv(T[:2, :3]))),
            r"coordinates.from_pose fails at .*test_contract\.py:\d+: a 2 × 3 matrix has no inverse",
        ),
        (
            lambda f: replace(f, coordinates=replace(f.coordinates, to_pose=lambda *x: x[0])),
            r"must return a pose of shape \(4, 4\)",
        ),
        (
            lambda f: replace(f, equations=(*f.equations, Equation(
                "late", "", "x", "helper", ("w",), {"corrected": lambda w, D: w * w + D}))),
            "implicit in w and not linear",
        ),
    ],
)  # fmt: skip
def test_formula_that_does_not_fit_together_is_named(sils, change, message):
    with pytest.raises(KinematicsError, match=message):
        compile_formula(change(sils))


def test_unknown_equation_and_points(sils):
    with pytest.raises(KinematicsError, match=r"no equation 'eq3'. Did you mean 'eq2'\?"):
        compile_formula(sils, {"eq3": "printed"})
    kin = compile_formula(sils)
    with pytest.raises(KinematicsError, match="no point 's4'"):
        kin.joints_from_points({"s4": np.zeros((1, 3))})
    with pytest.raises(KinematicsError, match="'eq1' needs symbol 'X_E'"):
        kin.joints_from_points({"s1": np.zeros((1, 3))})
    with pytest.raises(KinematicsError, match=r"\(k, 3\) arrays"):
        kin.joints_from_points({})


def test_pose_that_is_not_rigid_is_refused(sils):
    kin = compile_formula(sils)
    T = np.eye(4)
    T[:3, 3] = 0.38, 0.28, 0.185
    kin.inverse(T)
    T[0, 0] = 1.001
    with pytest.raises(KinematicsError, match="Check that the pose is rigid and in metres"):
        kin.inverse(T)
    assert np.isnan(kin.inverse_many(T[None])).all()
    with pytest.raises(KinematicsError, match="the Jacobian does not exist at this pose"):
        kin.jacobian(np.eye(4) + np.diag([0, 0, 0, 0]) + 9 * np.eye(4, k=3))


def test_printed_rows_are_what_the_paper_prints(sils):
    """The implicit rows hold when the solved joints are put back into them."""
    p = {k.name: k.value for k in sils.parameters}
    T = np.eye(4)
    T[:3, 3] = 0.38, 0.28, 0.185
    L, l1 = p["l_1"] + p["l_2"], p["l_1"]
    kin = compile_formula(sils, "printed")
    assert kin.variants == {"eq1": "printed", "eq2": "printed"}
    q, S = kin.inverse(T), kin.points_many(T[None])
    assert q[0] == pytest.approx(L / (2 * l1) * (q[1] - q[0]) + S["s1"][0, 2], abs=1e-14)
    assert q[2] == pytest.approx(L / (2 * l1) * (q[3] - q[2]) + S["s2"][0, 1], abs=1e-14)
    q = compile_formula(sils).inverse(T)
    assert q[1] == pytest.approx(L / (2 * l1) * (q[1] - q[0]) + S["s1"][0, 2], abs=1e-14)
