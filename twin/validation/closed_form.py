"""Judge published equations of motion in closed form (A) against the dynamics of the mechanism (B), term by term.

The compared terms are the elements of the mass matrix and, for each joint, the Coriolis and centrifugal effort and the
gravity effort. They are compared at random states of the published joints; all other joints are at zero and at rest.
Rotors and friction are not part of the published equations and are omitted in B. Two properties of A are checked
without B: M is positive definite, and qd^T (dM/dt - 2 C) qd = 0, the power balance (R. M. Murray, Z. Li, S. S. Sastry,
A Mathematical Introduction to Robotic Manipulation, CRC Press 1994, lemma 4.2).

If terms differ, single edits of the equations are tried: one inertial parameter, the sign of a term, the direction of
gravity. An edit is reported only if it explains all differences.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from twin.core.errors import KinematicsError, unknown
from twin.core.findings import Finding, Kind
from twin.core.quantity import Quantity
from twin.core.spatial import Array
from twin.formula.closed_form import ClosedForm, Terms
from twin.reference.dynamics import Dynamics

_EXPLAINED_REMAINDER = 1e-2
"""An edit explains the differences if it reduces their norm to less than this fraction of the original norm.

The rounding of published parameters leaves a smaller fraction.
"""

_LARGEST_RATES = (1.0, 0.2)
"""Largest rates of the random states, in rad/s and m/s; similar to the largest speeds of the arm."""

_BALANCE_TOLERANCE = 1e-9
"""Tolerance of the power balance, relative to the largest term."""

_DIFFERS = Kind("motion.differs", "disagreement", "correct the term or its parameters in the equations of motion")
_INCONSISTENT = Kind("motion.inconsistent", "disagreement", "derive C from M, by the Christoffel symbols")


@dataclass(frozen=True)
class TermRow:
    """Comparison of one term: name, largest difference `worst` and its tolerance, both in the SI unit `unit`."""

    term: str
    worst: float
    unit: str
    limit: float

    @property
    def agrees(self) -> bool:
        """Whether the largest difference is within the tolerance."""
        return bool(self.worst <= self.limit)


@dataclass
class JudgedForm:
    """Result of comparing published equations of motion with a mechanism.

    Attributes:
        rows: largest difference of each term.
        cause: the single edit that explains all differences; "" without differences or without such an edit.
        balance: largest |qd^T (dM/dt - 2 C) qd| of the published equations, divided by the largest term.
        least: smallest eigenvalue of the published mass matrix, in SI.
        findings: terms that differ.
    """

    rows: list[TermRow] = field(default_factory=list)
    cause: str = ""
    balance: float = 0.0
    least: float = np.inf
    findings: list[Finding] = field(default_factory=list)


def judge(form: ClosedForm, dynamics: Dynamics, count: int = 200, seed: int = 0) -> JudgedForm:
    """Compare published equations of motion with the dynamics of a mechanism at `count` random states.

    Raises:
        KinematicsError: the mechanism does not have one of the published joints.
    """
    active = dynamics.mechanism.active
    names = [joint.name for joint in active]
    published: list[int] = []
    is_angle: list[bool] = []
    limits_of_published = []
    for name in form.joints:
        if name not in names:
            raise KinematicsError(f"equations of motion: {unknown('driven joint', name, names)}")
        i = names.index(name)
        published.append(i)
        is_angle.append(active[i].is_angle)
        limits_of_published.append(active[i].limits)
    limits = np.array(limits_of_published)
    evaluate = form.compiled()
    rng = np.random.default_rng(seed)
    states: list[_State] = []
    for _ in range(count):
        q = np.zeros(len(names))
        qd = np.zeros(len(names))
        q[published] = rng.uniform(limits[:, 0], limits[:, 1])
        qd[published] = rng.uniform(-1, 1, len(published)) * np.where(is_angle, *_LARGEST_RATES)
        # joints that are not published stay at zero and at rest: so does their share of the efforts
        terms = evaluate(q[published], qd[published])
        # the published equations have no rotors
        M = (dynamics.mass_matrix(q) - dynamics.rotor)[np.ix_(published, published)]
        c = dynamics.coriolis(q, qd)[published]
        g = dynamics.gravity(q)[published]
        states.append(_State(qd[published], A=terms, M=M, c=c, g=g))
    result = JudgedForm()
    _check_consistency(states, result)
    _compare_terms(form, is_angle, states, result)
    wrong = [row for row in result.rows if not row.agrees]
    if wrong:
        result.cause = _explaining_edit(form, states)
        if not result.cause and len(wrong) == 1:
            result.cause = f"the term {wrong[0].term}"
    for row in wrong:
        text = f"the published {row.term} differs from the value of the mechanism"
        worst = Quantity(row.worst, row.unit)
        limit = Quantity(row.limit, row.unit)
        result.findings.append(_DIFFERS(row.term, text, worst, limit, cause=result.cause))
    return result


@dataclass(frozen=True)
class _State:
    """One random state: rates (n,) of the published joints, the published terms `A`, and those of the mechanism.

    Attributes:
        qd: rates in rad/s and m/s.
        A: published terms.
        M, c, g: mass matrix (n, n), Coriolis efforts (n,) and gravity efforts (n,) of the mechanism.
    """

    qd: Array
    A: Terms
    M: Array
    c: Array
    g: Array


def _check_consistency(states: list[_State], result: JudgedForm) -> None:
    """Check the published equations alone: smallest eigenvalue of the mass matrix, and power balance."""
    for state in states:
        result.least = min(result.least, float(np.linalg.eigvalsh(state.A.M)[0]))
        power = state.qd @ (state.A.M_rate - 2 * state.A.C) @ state.qd
        # the smallest number, not 0, also of a state whose mass matrix does not change
        scale = max(np.abs(np.outer(state.qd, state.qd) * state.A.M_rate).max(), np.finfo(float).tiny)
        result.balance = max(result.balance, abs(power) / scale)
    if result.least <= 0:
        result.findings.append(
            _INCONSISTENT(
                "mass matrix", "the smallest eigenvalue of M is not positive", Quantity(result.least, ""), 0.0
            )
        )
    if result.balance > _BALANCE_TOLERANCE:
        result.findings.append(
            _INCONSISTENT(
                "Coriolis term",
                "qd^T (dM/dt - 2 C) qd is not zero; size relative to the largest term",
                Quantity(result.balance, ""),
                _BALANCE_TOLERANCE,
            )
        )


def _compare_terms(form: ClosedForm, is_angle: list[bool], states: list[_State], result: JudgedForm) -> None:
    """Add a row for each element of the mass matrix, and for the Coriolis and the gravity effort of each joint."""
    differences = _Differences.of(states)
    M = np.abs(differences.M)
    inertia_units = {2: "kg m2", 1: "kg m", 0: "kg"}  # by the number of angles among two joints
    for i, joint in enumerate(form.joints):
        for j, other_joint in enumerate(form.joints[: i + 1]):
            name = f"inertia {joint}"
            if i != j:
                name = f"inertia {other_joint}-{joint}"
            # both halves: a published matrix may lack its symmetry
            worst = max(M[:, i, j].max(), M[:, j, i].max())
            unit = inertia_units[is_angle[i] + is_angle[j]]
            result.rows.append(TermRow(name, worst, unit, form.tolerance))
    for term, efforts in (("Coriolis", differences.c), ("gravity", differences.g)):
        for i, joint in enumerate(form.joints):
            unit = "N m" if is_angle[i] else "N"
            worst = np.abs(efforts[:, i]).max()
            result.rows.append(TermRow(f"{term} {joint}", worst, unit, form.tolerance))


@dataclass(frozen=True)
class _Differences:
    """Terms of the mechanism minus the published terms, at k states.

    Attributes:
        M, c, g: mass matrices (k, n, n), Coriolis efforts (k, n) and gravity efforts (k, n).
        coriolis, gravity: the published efforts (k, n).
    """

    M: Array
    c: Array
    g: Array
    coriolis: Array
    gravity: Array

    @classmethod
    def of(cls, states: list[_State]) -> _Differences:
        """Return the differences at the states."""
        M = []
        c = []
        g = []
        coriolis = []
        gravity = []
        for state in states:
            coriolis.append(state.A.C @ state.qd)
            gravity.append(state.A.g)
            M.append(state.M - state.A.M)
            c.append(state.c - coriolis[-1])
            g.append(state.g - state.A.g)
        return cls(np.array(M), np.array(c), np.array(g), np.array(coriolis), np.array(gravity))


def _explaining_edit(form: ClosedForm, states: list[_State]) -> str:
    """Return the single edit that explains all differences, as text; "" if none does."""
    differences = _Differences.of(states)
    wrong_M = np.abs(differences.M).max() > form.tolerance
    wrong_c = np.abs(differences.c).max() > form.tolerance
    wrong_g = np.abs(differences.g).max() > form.tolerance
    if wrong_c and not wrong_M and not wrong_g:
        return (
            _wrong_sign(form, "the Coriolis effort", differences.c, differences.coriolis) or "C is inconsistent with M"
        )
    if wrong_g and not wrong_M and not wrong_c:
        sign = _wrong_sign(form, "gravity", differences.g, differences.gravity)
        if sign:
            return sign
    edits: list[str] = []
    for name, required, published, unit in _wrong_parameters(form, states, differences.M, differences.g):
        edits.append(f"{name} = {required:.6g} {unit} instead of {published:.6g}")
    return " or ".join(edits)


def _wrong_sign(form: ClosedForm, term: str, difference: Array, value: Array) -> str:
    """Return the wrong sign of a term, of one joint or of all joints, that explains the differences; "" if none does.

    `difference` and `value` (k, n) are the difference from the mechanism and the published value at k states.
    """
    joints = np.flatnonzero(np.abs(difference).max(axis=0) > form.tolerance)
    if len(joints) == 1:
        i = joints[0]
        # with the other sign, the published value changes by minus twice itself
        if _remaining_difference(difference[:, i], -2 * value[:, i]) < _EXPLAINED_REMAINDER:
            return f"the sign of {term} of {form.joints[i]}"
    if _remaining_difference(difference, -2 * value) < _EXPLAINED_REMAINDER:
        return f"the sign of {term}"
    return ""


def _remaining_difference(difference: Array, edit: Array) -> float:
    """Return the norm of the difference after an edit, divided by the norm before the edit."""
    size = float(np.linalg.norm(difference))
    if not size:
        return 0.0
    return float(np.linalg.norm(difference - edit)) / size


def _wrong_parameters(
    form: ClosedForm, states: list[_State], M: Array, g: Array
) -> Iterator[tuple[str, float, float, str]]:
    """Yield (name, required value, published value, unit) of each parameter that alone explains all differences.

    With the required value instead of the published one, closed form and mechanism agree.
    """
    n = len(form.joints)
    # All entries of M and g at all states, one below the other: how they vary with each parameter, and what they lack.
    shares: list[Array] = []
    differences: list[Array] = []
    for i, state in enumerate(states):
        shares.append(state.A.M_by_parameters.reshape(n * n, len(form.parameters)))
        shares.append(state.A.g_by_parameters)
        differences.append(M[i].reshape(-1))
        differences.append(g[i])
    share = np.concatenate(shares)
    difference = np.concatenate(differences)
    for i, parameter in enumerate(form.parameters):
        column = share[:, i]
        if not np.any(column):
            continue
        step = float(column @ difference / (column @ column))  # least squares
        if _remaining_difference(difference, step * column) < _EXPLAINED_REMAINDER:
            yield parameter.name, parameter.value + step, parameter.value, parameter.unit
