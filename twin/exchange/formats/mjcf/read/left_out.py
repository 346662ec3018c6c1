"""Report the data of an MJCF that are not imported."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from twin.exchange.read.imported_robot import Findings


def find_left_out(model, name: Callable[[str, int], str], imported_tendons: Collection[int] = ()) -> Findings:
    """Return findings on data of the model that are not imported.

    `name` is a function (kind, number) that returns the name of an object. `imported_tendons` are the numbers of the
    tendons in transmissions.
    """
    import mujoco

    findings = Findings()
    for index in range(model.njnt):
        dof = int(model.jnt_dofadr[index])
        values = _stated_values(
            {
                "stiffness": float(np.ravel(model.jnt_stiffness[index])[0]),
                "damping": float(np.ravel(model.dof_damping[dof])[0]),
                "frictionloss": float(model.dof_frictionloss[dof]),
                "armature": float(model.dof_armature[dof]),
            }
        )
        if model.jnt_actfrclimited[index]:
            low, high = model.jnt_actfrcrange[index]
            values.append(f"actuatorfrcrange {low:g} .. {high:g}")
        if values:
            where = name("JOINT", index)
            findings.warn("friction", f"joint '{where}': {_not_imported(values)}", where)
    for index in range(1, model.nbody):
        if model.body_gravcomp[index]:
            where = name("BODY", index)
            values = _stated_values({"gravcomp": float(model.body_gravcomp[index])})
            findings.warn("gravcomp", f"body '{where}': {_not_imported(values)}", where)
    for index in imported_tendons:
        values = _stated_values(
            {
                "stiffness": np.ravel(model.tendon_stiffness[index])[0],
                "damping": np.ravel(model.tendon_damping[index])[0],
                "frictionloss": np.ravel(model.tendon_frictionloss[index])[0],
            }
        )
        if values:
            where = name("TENDON", index)
            findings.warn("friction", f"tendon '{where}': {_not_imported(values)}", where)
    imported = set(imported_tendons)
    for index in range(model.neq):
        if model.eq_type[index] == mujoco.mjtEq.mjEQ_TENDON:
            imported.add(int(model.eq_obj1id[index]))
    for index in range(model.ntendon):
        if index not in imported:
            where = name("TENDON", index)
            findings.warn("tendon", f"tendon '{where}' is not imported: no equality constrains its length.", where)
    for index in range(model.nexclude):
        signature = int(model.exclude_signature[index])  # MuJoCo packs the numbers of both bodies, with 16 bits each
        first = name("BODY", signature >> 16)
        second = name("BODY", signature & 0xFFFF)
        findings.note("contact", f"contact exclusion of '{first}' and '{second}' is not imported.", first)
    for index in range(model.npair):
        first = name("GEOM", int(model.pair_geom1[index]))
        second = name("GEOM", int(model.pair_geom2[index]))
        findings.note("contact", f"contact pair of '{first}' and '{second}' is not imported.", first)
    if model.neq:
        findings.note(
            "soft", "equality constraints are soft in MuJoCo, but exact in the mechanism.", name("EQUALITY", 0)
        )
    for count, what in ((model.nsensor, "sensors"), (model.ncam, "cameras"), (model.nlight, "lights")):
        if count:
            findings.note("unread", f"{count} {what} are not imported.", what)
    if model.nplugin:
        findings.warn("plugin", f"{model.nplugin} plug-ins are not imported.", "plugin")
    return findings


def _stated_values(values: Mapping[str, float]) -> list[str]:
    """Return a text "key value" for each value other than 0."""
    texts: list[str] = []
    for key, value in values.items():
        if value:
            texts.append(f"{key} {value:g}")
    return texts


def _not_imported(values: Sequence[str]) -> str:
    """Return the end of a sentence on values that are not imported."""
    verb = "is" if len(values) == 1 else "are"
    return f"{', '.join(values)} {verb} not imported."
