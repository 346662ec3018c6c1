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

_EXPLAINED = 1e-2
"""An edit explains the differences if it reduces their norm to less than this fraction of the original norm.

The rounding of published parameters leaves a smaller fraction.
"""

_RATES = (1.0, 0.2)
"""Largest rates of the random states, in rad/s and m/s; similar to the largest speeds of the arm."""

_BALANCE = 1e-9
"""Tolerance of the power balance, relative to the largest term."""

_DIFFERS = Kind("motion.differs", "disagreement", "correct the term or its parameters in the equations of motion")
_BROKEN = Kind("motion.inconsistent", "disagreement", "derive C from M, by the Christoffel symbols")


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
    names = [j.name for j in active]
    for name in form.joints:
        if name not in names:
            raise KinematicsError(f"equations of motion: {unknown('driven joint', name, names)}")
    at = [names.index(name) for name in form.joints]
    angle = [active[i].is_angle for i in at]
    evaluate = form.compiled()
    limits = np.array([active[i].limits for i in at])
    rng = np.random.default_rng(seed)
    states = []
    for _ in range(count):
        q, qd = np.zeros(len(names)), np.zeros(len(names))
        q[at] = rng.uniform(limits[:, 0], limits[:, 1])
        qd[at] = rng.uniform(-1, 1, len(at)) * np.where(angle, *_RATES)
        M = (dynamics.mass_matrix(q) - dynamics.rotor)[np.ix_(at, at)]
        states.append(_State(qd[at], evaluate(q[at], qd[at]), M, dynamics.coriolis(q, qd)[at], dynamics.gravity(q)[at]))
    out = JudgedForm()
    _consistent(states, out)
    _compare(form, angle, states, out)
    wrong = [r for r in out.rows if not r.agrees]
    if wrong:
        out.cause = _cause(form, states) or (f"the term {wrong[0].term}" if len(wrong) == 1 else "")
    for r in wrong:
        out.findings.append(
            _DIFFERS(
                r.term,
                f"the published {r.term} differs from the value of the mechanism",
                Quantity(r.worst, r.unit),
                Quantity(r.limit, r.unit),
                cause=out.cause,
            )
        )
    return out


@dataclass(frozen=True)
class _State:
    qd: Array
    A: Terms
    M: Array
    c: Array
    g: Array


def _consistent(states: list[_State], out: JudgedForm) -> None:
    """Check the published equations alone: smallest eigenvalue of the mass matrix, and power balance."""
    for s in states:
        out.least = min(out.least, float(np.linalg.eigvalsh(s.A.M)[0]))
        power = s.qd @ (s.A.change - 2 * s.A.C) @ s.qd
        scale = max(np.abs(np.outer(s.qd, s.qd) * s.A.change).max(), np.finfo(float).tiny)
        out.balance = max(out.balance, abs(power) / scale)
    if out.least <= 0:
        out.findings.append(
            _BROKEN("mass matrix", "the smallest eigenvalue of M is not positive", Quantity(out.least, ""), 0.0)
        )
    if out.balance > _BALANCE:
        out.findings.append(
            _BROKEN(
                "Coriolis term",
                "qd^T (dM/dt - 2 C) qd is not zero; size relative to the largest term",
                Quantity(out.balance, ""),
                _BALANCE,
            )
        )


def _compare(form: ClosedForm, angle: list[bool], states: list[_State], out: JudgedForm) -> None:
    joints, tol = form.joints, form.tolerance
    inertia = {2: "kg m2", 1: "kg m", 0: "kg"}
    for i, a in enumerate(joints):
        for j, b in enumerate(joints[: i + 1]):
            worst = max(abs(s.A.M[i, j] - s.M[i, j]) for s in states)
            asked = max(worst, *(abs(s.A.M[j, i] - s.M[j, i]) for s in states))
            name = f"inertia {a}" if i == j else f"inertia {b}-{a}"
            out.rows.append(TermRow(name, asked, inertia[angle[i] + angle[j]], tol))
    for i, a in enumerate(joints):
        unit = "N m" if angle[i] else "N"
        out.rows.append(TermRow(f"Coriolis {a}", max(abs((s.A.C @ s.qd - s.c)[i]) for s in states), unit, tol))
    for i, a in enumerate(joints):
        unit = "N m" if angle[i] else "N"
        out.rows.append(TermRow(f"gravity {a}", max(abs((s.A.g - s.g)[i]) for s in states), unit, tol))


def _cause(form: ClosedForm, states: list[_State]) -> str:
    """Return the single edit that explains all differences, as text; "" if none does."""
    M = np.stack([s.M - s.A.M for s in states])
    g = np.stack([s.g - s.A.g for s in states])
    c = np.stack([s.c - s.A.C @ s.qd for s in states])
    wrong = {n: np.abs(v).max() > form.tolerance for n, v in (("M", M), ("C", c), ("g", g))}
    if not wrong["M"]:
        for name, difference, value in (
            ("C", c, np.stack([s.A.C @ s.qd for s in states])),
            ("g", g, np.stack([s.A.g for s in states])),
        ):
            others = [n for n in wrong if wrong[n] and n != name]
            if others or not wrong[name]:
                continue
            for i, joint in enumerate(form.joints):
                only = [k for k in range(len(form.joints)) if np.abs(difference[:, k]).max() > form.tolerance]
                if only == [i] and _left(difference[:, i], -2 * value[:, i]) < _EXPLAINED:
                    return f"the sign of {_WORDS[name]} of {joint}"
            if _left(difference, -2 * value) < _EXPLAINED:
                return f"the sign of {_WORDS[name]}"
            if name == "C":
                return "C is inconsistent with M"
    found = list(_parameters(form, states, M, g))
    if not found:
        return ""
    edits = [f"{n} = {new:.6g} {unit} instead of {old:.6g}" for n, new, old, unit in found]
    return " or ".join(edits)


_WORDS = {"C": "the Coriolis effort", "g": "gravity"}


def _left(difference: Array, edit: Array) -> float:
    """Return the norm of the difference after an edit, divided by the norm before the edit."""
    size = float(np.linalg.norm(difference))
    return float(np.linalg.norm(difference - edit)) / size if size else 0.0


def _parameters(form: ClosedForm, states: list[_State], M: Array, g: Array) -> Iterator[tuple[str, float, float, str]]:
    """Yield (name, required value, published value, unit) of each parameter that alone explains all differences.

    With the required value instead of the published one, closed form and mechanism agree.
    """
    n, k = len(form.joints), len(form.parameters)
    share = np.concatenate([np.concatenate([s.A.M_share.reshape(n * n, k), s.A.g_share]) for s in states])
    size = np.concatenate([np.concatenate([M[i].reshape(-1), g[i]]) for i in range(len(states))])
    for i, parameter in enumerate(form.parameters):
        column = share[:, i]
        if not np.any(column):
            continue
        step = float(column @ size / (column @ column))
        if _left(size, step * column) < _EXPLAINED:
            yield parameter.name, parameter.value + step, parameter.value, parameter.unit
