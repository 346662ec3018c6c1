"""Compare the forward equations of a formula with the independent mechanism."""

from __future__ import annotations

import numpy as np

from twin.core.findings import Finding, Kind, disagreement
from twin.kinematics import Kinematics
from twin.reference import Run
from twin.validation.result import Residual
from twin.validation.rows import Clock, Tolerances, rotation_vectors, row

_FORWARD = Kind("tool.forward", "disagreement", word="tolerance")


def forward(
    kin: Kinematics, posed: Run, clock: Clock, tolerances: Tolerances, alone: bool = False
) -> tuple[list[Residual], list[Finding]]:
    """Return rows and findings on the tool pose of the forward equations at the mechanism's joint values.

    Unless `alone` is True, a formula with forward equations only is skipped, because driving the mechanism already
    checks these equations.
    """
    if not kin.closed_forward or not (kin.closed_inverse or alone):
        return [], []
    by = ", ".join(
        f"{e.name} ({kin.variants.get(e.name, e.default)})" for e in kin.formula.equations if e.stage == "forward"
    )
    Ts = kin.forward_many(posed.q)
    lost = ~np.isfinite(Ts).all(axis=(1, 2))
    if lost.any():
        k = int(np.argmax(lost))
        return [], [
            disagreement(
                "forward.no_answer",
                "tool",
                f"the forward equations have no real solution at {lost.sum()} of {len(Ts)} joint values that the "
                f"mechanism can take ({by})",
                when=f"{clock.phase(float(clock.t[k]))}, t = {clock.t[k]:.2f} s",
                cause=by,
            )
        ]
    offset = Ts[:, :3, 3] - posed.Ts_base_tool[:, :3, 3]
    turn = rotation_vectors(posed.Ts_base_tool, Ts)
    rows, findings = [], []
    for unit, values, tolerance in (
        ("m", offset, tolerances.position),
        ("rad", turn, tolerances.rotation),
    ):
        r = row("A-B", "tool", "tool, forward", unit, values, tolerance, clock, note=by)
        rows.append(r)
        if not r.agrees:
            findings.append(
                r.finding(
                    _FORWARD,
                    f"at the mechanism's joint values the tool pose of the forward equations ({by}) differs",
                    "tool",
                    cause=by,
                )
            )
    return rows, findings
