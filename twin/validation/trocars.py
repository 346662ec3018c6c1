"""Check that each shaft passes through its trocar, and that trocar positions on the stage and in the protocol agree."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.findings import Finding, Kind, finding
from twin.core.quantity import mm
from twin.core.units import MM
from twin.usd.read import read_stage
from twin.validation.case import Case
from twin.validation.compare import EquationsComparison
from twin.validation.rows import row

SINGLE = 1e-6
"""Tolerance in m of a position stored in single precision."""

_TROCAR = Kind(
    "rcm.trocar", "disagreement", "correct the frames of the trocar's joints or of the instrument", word="tolerance"
)


def through_trocars(case: Case, out: EquationsComparison) -> None:
    """Check the distance of each shaft axis from its trocar along the motion."""
    run, mechanism = out.posed, case.cad.mechanism
    held = {n: shaft for n in mechanism.trocars if (shaft := mechanism.shaft_through(n)) is not None}
    if run is None or not held:
        return
    links, tolerance = case.model.link_poses(run.x), case.protocol.tolerances.rcm
    for name, shaft in held.items():
        T = links[shaft.body] @ shaft.T_body_frame
        missed = spatial.point_to_line(mechanism.trocar_at(name), T[:, :3, 3], T[:, :3, 2])
        at, note = case.clock.at(out.coarse), f"{shaft.body} in trocar {name}"
        r = row("B", "rcm", name, "m", missed, tolerance, at, note=note)
        out.judge(r, _TROCAR, f"{shaft.body} misses trocar '{name}'")


def as_written(case: Case) -> list[Finding]:
    """Return a finding for each trocar whose position in the baked motion differs from the protocol."""
    mechanism = case.cad.mechanism
    if case.written is None or not mechanism.trocars:
        return []
    there = read_stage(case.written).trocar_places
    out = []
    for name, place in mechanism.trocar_places.items():
        if name not in there or (off := float(np.linalg.norm(there[name] - place))) <= SINGLE:
            continue  # a trocar missing on the stage is reported by the comparison of the stage
        at = ", ".join(f"{v / MM:.3f}" for v in there[name])
        out.append(
            finding(
                "disagreement" if case.baked_for_it else "warning",
                "baked.trocar",
                name,
                f"the motion on the stage has trocar '{name}' at ({at}) mm; distance from the trocar of the protocol",
                mm(off),
                mm(SINGLE),
                "run `twin build` again",
            )
        )
    return out
