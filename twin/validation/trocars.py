"""Check that each shaft passes through its trocar, and that trocar positions on the stage and in the protocol agree."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.findings import Finding, Kind, finding
from twin.core.quantity import mm
from twin.core.units import MM
from twin.usd.read import read_stage
from twin.validation.case import Case
from twin.validation.equations_comparison import EquationsComparison
from twin.validation.residual_rows import row

SINGLE_PRECISION = 1e-6
"""Tolerance in m of a position stored in single precision."""

_SHAFT_MISSES_TROCAR = Kind(
    "rcm.trocar", "disagreement", "correct the frames of the trocar's joints or of the instrument", word="tolerance"
)


def check_shafts_through_trocars(case: Case, comparison: EquationsComparison) -> None:
    """Check the distance of each shaft axis from its trocar along the motion."""
    run = comparison.posed
    mechanism = case.cad.mechanism
    shafts = {}
    for name in mechanism.trocars:
        shaft = mechanism.shaft_through(name)
        if shaft is not None:
            shafts[name] = shaft
    if run is None or not shafts:
        return
    links = case.model.link_poses(run.x)
    tolerance = case.protocol.tolerances.rcm
    times = case.clock.at(comparison.coarse)
    for name, shaft in shafts.items():
        T = links[shaft.body] @ shaft.T_body_frame
        # z of the frame is along the shaft
        distances = spatial.point_to_line(mechanism.trocar_at(name), T[:, :3, 3], T[:, :3, 2])
        residual = row(
            "B",
            "rcm",
            name,
            unit="m",
            differences=distances,
            tolerance=tolerance,
            clock=times,
            note=f"{shaft.body} in trocar {name}",
        )
        comparison.judge(residual, _SHAFT_MISSES_TROCAR, f"{shaft.body} misses trocar '{name}'")


def check_written_trocars(case: Case) -> list[Finding]:
    """Return a finding for each trocar whose position in the baked motion differs from the protocol."""
    mechanism = case.cad.mechanism
    if case.written is None or not mechanism.trocars:
        return []
    # a motion that was baked for another protocol may have the trocar elsewhere
    severity = "disagreement" if case.baked_for_it else "warning"
    # what is on disk is judged, not what would be written now
    written = read_stage(case.written).trocar_places
    findings = []
    for name, place in mechanism.trocar_places.items():
        if name not in written:
            continue  # a trocar missing on the stage is reported by the comparison of the stage
        distance = float(np.linalg.norm(written[name] - place))
        if distance <= SINGLE_PRECISION:
            continue
        position = ", ".join(f"{coordinate / MM:.3f}" for coordinate in written[name])
        text = (
            f"the motion on the stage has trocar '{name}' at ({position}) mm; distance from the trocar of the protocol"
        )
        findings.append(
            finding(
                severity,
                "baked.trocar",
                name,
                text,
                size=mm(distance),
                limit=mm(SINGLE_PRECISION),
                suggestion="run `twin build` again",
            )
        )
    return findings
