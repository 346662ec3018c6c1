"""Convert the expected mechanism to the common form of mechanism data, for comparison with files."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.physics import FREE_JOINT, Drive, Frame, Joint, Mass, Motor, Physics, along, felt

if TYPE_CHECKING:
    from twin.model.mechanism import Mechanism


def mechanism_physics(mechanism: Mechanism) -> Physics:
    """Return a mechanism in the common form of mechanism data; its loops need not be closed."""
    m = mechanism
    out = Physics(
        tuple(b.name for b in m.bodies),
        {b.name: Mass(b.inertia.mass, b.inertia.p_body_com, b.inertia.I_com) for b in m.bodies if b.inertia},
        shown={b.name: bool(b.meshes) for b in m.bodies if b.whole},
        gravity=np.array(m.gravity),
        held=frozenset({m.base}),
        tool=m.tool,
        trocars=frozenset(m.trocars),
        couplings={c.name: (dict(zip(c.joints, c.ratios, strict=True)), c.total) for c in m.couplings},
        motors=_motors(m),
        points={p.name: Frame(p.body, poses.pose(None, p.p_body)) for p in m.points},
        marks=frozenset({"frame", "point"}),
        all_motors=True,
        opening=0.0,
        floats={b.name: 0.0 for b in m.bodies},
        complete=True,
    )
    for j in m.joints:
        T = j.T_parent_joint @ poses.inverse(j.T_child_joint)
        out.joints.append(Joint((j.name,), j.parent, j.child, T, along(j.type, j.T_parent_joint), _drive(j, out)))
    out.frames = {f.name: Frame(f.body, f.T_body_frame) for f in m.frames}
    return out


def _motors(m: Mechanism) -> dict[str, Motor]:
    rows = {}
    for t in m.transmissions:
        for name, row in zip(t.actuators, np.linalg.inv(t.matrix), strict=True):
            rows[name] = {j: float(c) for j, c in zip(t.joints, row, strict=True) if c}
    return {
        a.name: Motor(
            rows[a.name],
            a.kind,
            a.limits or (-np.inf, np.inf),
            a.max_effort or np.inf,
            a.max_speed or np.inf,
            a.rotor_inertia or 0.0,
            a.stiffness or 0.0,
            a.damping,
        )
        for a in m.actuators
    }


def _drive(j, physics: Physics) -> Drive:
    if j.type not in ("revolute", "prismatic"):
        return Drive()
    gains = (None, None, None) if j.drive is None else (j.drive.stiffness, j.drive.damping, j.drive.max_effort)
    if (by_motors := felt(physics.motors or {}, j.name)) is not None:
        gains = (*by_motors, None)
    return Drive(j.limits or (-np.inf, np.inf), j.active, *gains, j.max_speed, FREE_JOINT, "force", np.inf)
