"""Report data of an MJCF that a mechanism cannot hold; data that affect the motion are reported as warnings."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from twin.core.findings import Finding
from twin.exchange.read.source import note, warning


def left_out(m, name: Callable[[str, int], str], kept_tendons: Collection[int] = ()) -> list[Finding]:
    """Return findings on data of the model that are not imported.

    Args:
        m: MuJoCo's model.
        name: function from kind and number of an object to its name in the file.
        kept_tendons: numbers of the tendons that transmissions use.
    """
    import mujoco

    found: list[Finding] = []
    for i in range(m.njnt):
        dof = int(m.jnt_dofadr[i])
        told = {
            "stiffness": float(np.ravel(m.jnt_stiffness[i])[0]),
            "damping": float(np.ravel(m.dof_damping[dof])[0]),
            "frictionloss": float(m.dof_frictionloss[dof]),
            "armature": float(m.dof_armature[dof]),
        }
        kept = [f"{k} {v:g}" for k, v in told.items() if v]
        if m.jnt_actfrclimited[i]:
            kept.append(f"actuatorfrcrange {m.jnt_actfrcrange[i, 0]:g} .. {m.jnt_actfrcrange[i, 1]:g}")
        if kept:
            where = name("JOINT", i)
            found.append(warning("friction", f"joint '{where}': {', '.join(kept)} are not imported.", where))
    tied = {int(m.eq_obj1id[i]) for i in range(m.neq) if m.eq_type[i] == mujoco.mjtEq.mjEQ_TENDON}
    for i in kept_tendons:
        told = {k: np.ravel(getattr(m, f"tendon_{k}")[i])[0] for k in ("stiffness", "damping", "frictionloss")}
        if kept := [f"{k} {v:g}" for k, v in told.items() if v]:
            where = name("TENDON", i)
            found.append(warning("friction", f"tendon '{where}': {', '.join(kept)} are not imported.", where))
    for i in set(range(m.ntendon)) - tied - set(kept_tendons):
        where = name("TENDON", i)
        found.append(warning("tendon", f"tendon '{where}' is not imported: no equality constrains its length.", where))
    for i in range(m.nexclude):
        a, b = (name("BODY", int(v)) for v in (m.exclude_signature[i] >> 16, m.exclude_signature[i] & 0xFFFF))
        found.append(note("contact", f"contact exclusion of '{a}' and '{b}' is not imported.", a))
    for i in range(m.npair):
        a, b = (name("GEOM", int(v)) for v in (m.pair_geom1[i], m.pair_geom2[i]))
        found.append(note("contact", f"contact pair of '{a}' and '{b}' is not imported.", a))
    if m.neq:
        found.append(note("soft", "equalities are soft in MuJoCo, but exact in the mechanism.", name("EQUALITY", 0)))
    for count, what in ((m.nsensor, "sensors"), (m.ncam, "cameras"), (m.nlight, "lights")):
        if count:
            found.append(note("unread", f"{count} {what} are not imported.", what))
    if m.nplugin:
        found.append(warning("plugin", f"{m.nplugin} plug-ins are not imported.", "plugin"))
    return found
