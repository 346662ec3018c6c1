"""The forward equations of a formula that leads both ways, judged by the independent model."""

from __future__ import annotations

import numpy as np

from twin.core.findings import Finding
from twin.core.units import DEG, MM
from twin.kinematics import Kinematics
from twin.reference import Run
from twin.validation.result import Residual
from twin.validation.rows import Clock, Tolerances, rotation_vectors, row, text


def forward(
    kin: Kinematics, posed: Run, clock: Clock, tolerances: Tolerances, alone: bool = False
) -> tuple[list[Residual], list[Finding]]:
    """Return rows and findings: where the forward equations put the tool at the mechanism's own joint values.

    Nothing for a formula that leads only one way, where driving the mechanism judges that way already; `alone` says
    that it does not.
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
            Finding(
                "forward.no_answer",
                "disagreement",
                f"the forward equations have no real solution at {lost.sum()} of {len(Ts)} joint values that the "
                f"mechanism can take ({by})",
                where="tool",
                when=f"{clock.phase(float(clock.t[k]))}, t = {clock.t[k]:.2f} s",
                cause=by,
            )
        ]
    offset = Ts[:, :3, 3] - posed.Ts_base_tool[:, :3, 3]
    turn = rotation_vectors(posed.Ts_base_tool, Ts)
    rows, findings = [], []
    for unit, values, tolerance, scale in (
        ("m", offset, tolerances.position, MM),
        ("rad", turn, tolerances.rotation, DEG),
    ):
        r = row("A-B", "tool", "tool, forward", unit, values, tolerance, clock, note=by)
        rows.append(r)
        if not r.agrees:
            findings.append(
                Finding(
                    "tool.forward",
                    "disagreement",
                    f"at the mechanism's joint values the forward equations put the tool "
                    f"{text(r.worst, unit)} off ({by})",
                    where="tool",
                    when=f"{r.phase}, t = {r.t:.2f} s",
                    size=r.worst / scale,
                    unit="mm" if unit == "m" else "deg",
                    limit=tolerance / scale,
                    cause=by,
                )
            )
    return rows, findings
