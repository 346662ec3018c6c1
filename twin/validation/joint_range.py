"""Compare the equations with the mechanism over the whole joint range; a protocol is only a small part of it.

An inverse that uses atan instead of atan2 is right near home and wrong behind the robot. Therefore the mechanism is put
into states all over its joint range (`reference.joint_range`), and the equations are evaluated at the tool poses and at
the joint values of these states. Joint values of another solution of the same pose are right: the mechanism is driven
to them, and its tool pose is compared.
"""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.findings import Kind
from twin.core.spatial import Array
from twin.core.units import display_unit
from twin.kinematics import Kinematics
from twin.reference import ReferenceModel
from twin.reference.closing import Closing
from twin.reference.joint_range import JointRange, joint_range
from twin.validation.case import Case
from twin.validation.compare import Comparison
from twin.validation.result import Residual
from twin.validation.rows import rotation_vectors

HEADING = "joint range"

_SLACK = 10.0
"""Factor on the tolerances of the protocol: singularities at the ends of the range magnify rounding errors."""

_DIFFERS = Kind(
    "range.differs",
    "disagreement",
    "the equations are wrong in a part of the joint range: look for a quadrant (atan for atan2), a sign or a branch",
    word="tolerance",
)
_FOLLOWS = Kind("range.differs", "info", word="tolerance")
_NO_ANSWER = Kind(
    "range.no_answer",
    "disagreement",
    "extend the equations, or state where they end by a row of `reach` in the formula",
    word="",
)


def whole_range(case: Case, out: Comparison) -> None:
    """Add rows, findings and facts of the comparison over the joint range to `out`."""
    kin, model = case.kinematics, case.model
    if kin is None or not model.mechanism.active:
        return
    drawn = joint_range(model)
    beyond = _beyond(kin, drawn)
    inside = ~np.any(list(beyond.values()), axis=0) if beyond else np.ones(len(drawn.run.x), bool)
    if not inside.any():
        return
    errors = {}
    if kin.closed_inverse:
        errors["inverse"] = _of_inverse(kin, model, drawn, case)
    if kin.closed_forward:
        errors["forward"] = _of_forward(kin, drawn)
    out.facts[HEADING] = _facts(drawn, inside, beyond, model)
    wrong_before = next((r.name for r in out.residuals if r.pair == "A-B" and not r.agrees), "")
    for name, (offset, turn) in errors.items():
        _judge(name, offset, turn, inside, drawn, wrong_before, case, out)


def _beyond(kin: Kinematics, drawn: JointRange) -> dict[str, np.ndarray]:
    """Return {name of a row of reach: (k,) bool, whether a state is beyond it} for rows that exclude any state."""
    run = drawn.run
    rows = dict(kin.reach(Ts=run.Ts_base_tool))
    out = {name: ~(margin >= 0) for name, margin in rows.items()}
    if kin.closed_forward:
        for name, margin in kin.reach(qs=run.q).items():
            out[name] = out[name] | (margin < 0)
    return {name: beyond for name, beyond in out.items() if beyond.any()}


def _of_inverse(kin: Kinematics, model: ReferenceModel, drawn: JointRange, case: Case) -> tuple[Array, Array]:
    """Return the errors (k,) in m and (k,) in rad of the tool pose at the joint values of the inverse equations.

    The error is 0 where the equations give the joint values of the state, NaN where they give none, and infinite where
    the mechanism cannot take the joint values that they give.
    """
    run = drawn.run
    q = kin.inverse_many(run.Ts_base_tool)
    q[:, kin.auxiliary] = run.q[:, kin.auxiliary]
    difference = q - run.q
    turns = np.round(difference / (2 * np.pi))
    difference[:, kin.revolute] -= 2 * np.pi * turns[:, kin.revolute]
    limit = np.where(kin.revolute, case.tolerances.rotation, case.tolerances.position)
    answered = np.isfinite(q).all(axis=1)
    other = np.flatnonzero(answered & (np.abs(difference) > limit).any(axis=1))
    offset = np.where(answered, 0.0, np.nan)
    turn = offset.copy()
    if len(other):
        states, possible = Closing(model, np.ones(q.shape[1])).states(q[other])
        Ts = model.collect(states).Ts_base_tool
        true = run.Ts_base_tool[other]
        offset[other] = np.where(possible, np.linalg.norm(Ts[:, :3, 3] - true[:, :3, 3], axis=1), np.inf)
        turn[other] = np.where(possible, np.linalg.norm(rotation_vectors(true, Ts), axis=1), np.inf)
    return offset, turn


def _of_forward(kin: Kinematics, drawn: JointRange) -> tuple[Array, Array]:
    """Return the errors (k,) in m and (k,) in rad of the tool poses of the forward equations; NaN without a pose."""
    true = drawn.run.Ts_base_tool
    Ts = kin.forward_many(drawn.run.q)
    finite = np.isfinite(Ts).all(axis=(1, 2))
    offset = np.full(len(Ts), np.nan)
    turn = offset.copy()
    offset[finite] = np.linalg.norm(Ts[finite, :3, 3] - true[finite, :3, 3], axis=1)
    turn[finite] = spatial.rotation_angle(np.swapaxes(true[finite, :3, :3], 1, 2) @ Ts[finite, :3, :3])
    return offset, turn


def _judge(
    name: str,
    offset: Array,
    turn: Array,
    inside: np.ndarray,
    drawn: JointRange,
    wrong_before: str,
    case: Case,
    out: Comparison,
) -> None:
    """Add two rows, position and rotation, and findings, for the errors of the equations `name` at the states."""
    tolerances = case.tolerances
    kind = _FOLLOWS if wrong_before else _DIFFERS
    missing = inside & np.isnan(offset)
    if missing.any():
        k = int(np.flatnonzero(missing)[0])
        what = (
            f"over the joint range, the {name} equations give no result at {_share(missing, inside)} that the "
            "mechanism can take"
        )
        found = _NO_ANSWER(name, what, when=_state(drawn, k, case))
        out.findings.append(found)
    limits = (("m", offset, _SLACK * tolerances.position), ("rad", turn, _SLACK * tolerances.rotation))
    judged = inside & ~np.isnan(offset)
    told = False
    for unit, error, limit in limits:
        worst = int(np.argmax(np.where(judged, error, -1.0)))
        finite = error[judged & np.isfinite(error)]
        row = Residual(
            "A-B",
            "range",
            name,
            unit,
            float(error[worst]) if judged.any() else 0.0,
            float(np.sqrt(np.mean(finite**2))) if len(finite) else 0.0,
            limit,
            0.0,
            HEADING,
            samples=int(judged.sum()),
            consequence_of=wrong_before,
            note=f"over the joint range: {_state(drawn, worst, case)}",
        )
        out.residuals.append(row)
        wrong = judged & (error > limit)
        if wrong.any() and not told:
            told = True
            text = f"over the joint range, the {name} equations are wrong at {_share(wrong, inside)}"
            out.findings.append(row.finding(kind, text, when=_state(drawn, worst, case), cause=name))


def _share(some: np.ndarray, of: np.ndarray) -> str:
    """Return "n of k states (p %)"."""
    return f"{some.sum()} of {of.sum()} states ({100 * some.sum() / of.sum():.0f} %)"


def _state(drawn: JointRange, k: int, case: Case) -> str:
    """Return the joint values of state k as text, in mm and degrees."""
    parts = []
    for joint, value in zip(case.cad.mechanism.active, drawn.run.q[k], strict=True):
        unit, scale = display_unit(joint.is_angle)
        parts.append(f"{joint.name} = {value / scale:.1f} {unit}")
    return ", ".join(parts)


def _facts(
    drawn: JointRange, inside: np.ndarray, beyond: dict[str, np.ndarray], model: ReferenceModel
) -> dict[str, str]:
    """Return what was judged: share and number of states, excluded states, and the range of each joint."""
    out = {"judged": f"{100 * inside.mean():.0f} % of the joint range, {inside.sum()} states"}
    for name, states in beyond.items():
        out[f"beyond '{name}' of the equations"] = f"{100 * states.mean():.0f} % of the states, not judged"
    values = drawn.run.q
    for i, joint in enumerate(model.mechanism.active):
        unit, scale = display_unit(joint.is_angle)
        first, last = values[:, i].min() / scale, values[:, i].max() / scale
        text = f"{first:.1f} .. {last:.1f} {unit}"
        if drawn.share[i] < 0.98:
            low, high = drawn.low[i] / scale, drawn.high[i] / scale
            text += f"; not reached: the rest of {low:.1f} .. {high:.1f} {unit}"
        if joint.limits is None:
            text += "; the joint has no limits"
        out[joint.name] = text
    return out
