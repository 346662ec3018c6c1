"""The trocars of a mechanism: each shaft goes through its own, and the motion on the stage has each where it is."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.findings import Finding
from twin.core.units import MM
from twin.reference import ReferenceModel
from twin.usd.read import read_stage
from twin.validation.case import Case
from twin.validation.compare import Comparison
from twin.validation.rows import Clock, row, text

SINGLE = 1e-6
"""How far in m single precision may bring a place on a stage."""


def through_trocars(case: Case, model: ReferenceModel, out: Comparison, clock: Clock) -> None:
    """Judge how far the axis of each shaft passes its trocar, where the mechanism goes."""
    run, mechanism = out.posed, model.mechanism
    held = {n: shaft for n in mechanism.trocars if (shaft := mechanism.shaft_through(n)) is not None}
    if run is None or not held:
        return
    links, tolerance = model.link_poses(run.x), case.protocol.tolerances.rcm
    for name, shaft in held.items():
        T = links[shaft.body] @ shaft.T_body_frame
        missed = spatial.point_to_line(mechanism.trocar_at(name), T[:, :3, 3], T[:, :3, 2])
        r = row("B", "rcm", name, "m", missed, tolerance, clock.at(out.coarse), note=f"{shaft.body} in trocar {name}")
        out.residuals.append(r)
        if not r.agrees:
            out.findings.append(
                Finding(
                    "rcm.trocar",
                    "disagreement",
                    f"{shaft.body} passes trocar '{name}' at {text(r.worst, 'm')}",
                    where=name,
                    when=f"{r.phase}, t = {r.t:.2f} s",
                    size=r.worst / MM,
                    unit="mm",
                    limit=tolerance / MM,
                    suggestion="correct the frames of its joints, or what slides in it",
                )
            )


def as_written(case: Case) -> list[Finding]:
    """Return a finding for each trocar that the motion beside the stage has elsewhere than the protocol."""
    mechanism = case.cad.mechanism
    if case.written is None or not mechanism.trocars:
        return []
    there = read_stage(case.written).trocar_places
    out = []
    for name, place in mechanism.trocar_places.items():
        if name not in there or (off := float(np.linalg.norm(there[name] - place))) <= SINGLE:
            continue  # one that is not marked is told by what is compared of the stage itself
        at = ", ".join(f"{v / MM:.3f}" for v in there[name])
        out.append(
            Finding(
                "baked.trocar",
                "disagreement" if case.baked_for_it else "warning",
                f"the motion on the stage has trocar '{name}' at ({at}) mm, {off / MM:.4g} mm from where the protocol "
                "has it",
                where=name,
                size=off / MM,
                unit="mm",
                limit=SINGLE / MM,
                suggestion="bake it again with `twin build`",
            )
        )
    return out
