"""Prove limits, speeds, RCM, loops and clearance along protocols, at every moment of the timed path."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin.api.path_samples import SampledPath, sampled
from twin.api.robot import Robot
from twin.core.errors import MechanismError, ProtocolError
from twin.core.findings import Finding, disagreement, error, info
from twin.core.json_types import JsonObject
from twin.core.progress import Progress, silent
from twin.core.quantity import si
from twin.core.result import TextTable
from twin.core.spatial import Array
from twin.core.units import MM
from twin.proof.motion import value_groups as groups

if TYPE_CHECKING:
    from twin.planning.path_kinematics import PathKinematics
    from twin.planning.protocol import Protocol
    from twin.planning.trajectory import PhaseSpan, Trajectory
    from twin.proof.motion.motion_claims import MotionClaim, MotionProof
    from twin.proof.motion.path import TimedPath, TimedPhase

_SAMPLE_TOLERANCE = 1e-8
"""Distance in SI units by which a sampled value may be beyond a proved bound: errors of solvers and of the series."""

_CLEARANCE = 1 * MM
"""Pairs of bodies that are nearer than twice this in the CAD touch by design; their clearance is not proved."""

_FIRST_DIFFERENCE = 0.5 * MM
"""Accepted difference between the smallest distance that is found and the proved one, at first."""

_TOUCHING = 1e-6
"""Distance in m below which bodies touch: a bound below it would say no more, and its search would not end."""

_NAMED_CLAIMS = 4
"""Number of claims that a finding names."""

_LARGEST_BOUND_RATIO = 1.4
"""Ratio of the smallest distance that is found to the proved one, above which the difference is made smaller."""


@dataclass(frozen=True)
class ProvedClearance:
    """The smallest distance between bodies in one phase.

    Attributes:
        phase: name of the phase.
        proved: lower bound in m at every moment, with any timing.
        found: smallest distance in m that was found.
        bodies: names of the two bodies.
    """

    phase: str
    proved: float
    found: float
    bodies: tuple[str, str]


@dataclass(frozen=True)
class ProvedMotion:
    """What is proved along one protocol.

    Attributes:
        proof: the claims, with their bounds over time.
        samples: the same values of the plan and of the reference model at sampled times.
        clearances: smallest distances by phase; empty if they were not asked for, or no bodies are tested.
        digest: SHA-256 of the protocol's file; "" without a file.
        findings: a disagreement for each refuted claim, an error for each claim and each distance that is not proved.
        open_phases: {phase: why no distance was found in it}; an empty reason if no two bodies are compared.
        certificate: path, mechanism and bounds for docs/check_motion.py and the audit; None if nothing is proved.
    """

    proof: MotionProof
    samples: SampledPath
    clearances: tuple[ProvedClearance, ...]
    digest: str
    findings: tuple[Finding, ...]
    open_phases: Mapping[str, str] = field(default_factory=dict)
    certificate: JsonObject | None = None

    @property
    def protocol(self) -> str:
        """Name of the protocol."""
        return self.proof.protocol

    def extreme(self, claim: MotionClaim) -> float | None:
        """Return the smallest (largest) sampled value of a claim; None if it was not sampled."""
        values = self.samples.values.get((claim.group, claim.name))
        if values is None or not np.isfinite(values).any():
            return None
        # NaN where there is no value, as the distance from the RCM in a phase without one
        if claim.smallest:
            return float(np.nanmin(values))
        return float(np.nanmax(values))

    def record(self) -> JsonObject:
        """Return the claims as plain data."""
        claims = []
        for claim in self.proof.claims:
            # an extreme is enclosed by [low, high]; one end is the proved bound, and the other is certainly reached
            claims.append(
                {
                    "name": claim.name,
                    "kind": claim.group,
                    "unit": claim.unit,
                    "extreme": "smallest" if claim.smallest else "largest",
                    "proved_bound": claim.bound,
                    "certainly_reached": claim.high if claim.smallest else claim.low,
                    "sampled": self.extreme(claim),
                    "limit": claim.limit,
                    "verdict": claim.status,
                    "phase": claim.phase,
                    "t": claim.t,
                    "reason": claim.reason,
                }
            )
        clearances = []
        for clearance in self.clearances:
            clearances.append(
                {
                    "phase": clearance.phase,
                    "proved": clearance.proved,
                    "found": clearance.found,
                    "bodies": list(clearance.bodies),
                }
            )
        return {
            "protocol": self.protocol,
            "protocol_sha256": self.digest,
            "duration": self.proof.duration,
            "pieces": self.proof.pieces,
            "intervals": self.proof.cells,
            "claims": claims,
            "clearances": clearances,
        }

    def entry(self) -> JsonObject:
        """Return the entry of the certificate: what is proved, about which file of the protocol."""
        proved = []
        for claim in self.proof.claims:
            if claim.status == "proved":
                kind = "at least" if claim.smallest else "at most"
                row = {"value": claim.name, "kind": claim.group, "unit": claim.unit, kind: claim.bound}
                if np.isfinite(claim.limit):
                    row["limit"] = claim.limit
                proved.append(row)
        return {
            "protocol": self.protocol,
            "protocol_sha256": self.digest,
            "method": "Taylor models of order 5 with outward rounding; loops by Krawczyk's operator",
            "pieces": self.proof.pieces,
            "proved": proved,
        }

    def table(self) -> TextTable:
        """Return the claims as a table."""
        rows = []
        for claim in self.proof.claims:
            sampled_value = self.extreme(claim)
            relation = ">=" if claim.smallest else "<="
            rows.append(
                (
                    label(claim),
                    claim.status,
                    f"{relation} {shown(claim.bound, claim.unit)}",
                    "-" if sampled_value is None else shown(sampled_value, claim.unit),
                    _limit(claim),
                    claim.phase,
                )
            )
        for clearance in self.clearances:
            rows.append(
                (
                    f"clearance: {' and '.join(clearance.bodies)}",
                    "proved" if clearance.proved > 0 else "unproved",
                    f">= {shown(clearance.proved, 'm')}",
                    shown(clearance.found, "m"),
                    "-",
                    clearance.phase,
                )
            )
        return TextTable((f"along {self.protocol}", "verdict", "at every moment", "sampled", "limit", "phase"), rows)


_LABELS = {
    groups.JOINT_LIMIT: "joint {}: distance from its limits",
    groups.JOINT_SPEED: "joint {}: speed",
    groups.MOTOR_LIMIT: "motor {}: distance from its limits",
    groups.MOTOR_SPEED: "motor {}: speed",
    groups.GAP: "gap {}",
    groups.PASSIVE_LIMIT: "passive joint {}: distance from its limits",
    groups.RCM: "distance of the shaft from the RCM, {}",
    groups.TOOL_SPEED: "{} speed / its limit",
    groups.LOOP_GAP: "gap of the {}",
    groups.DETERMINANT: "determinant of the {} / that at the start",
}
"""{group of claims: text with a place for the name}."""


def label(claim: MotionClaim) -> str:
    """Return what a claim is about."""
    return _LABELS[claim.group].format(claim.name)


def shown(value: float, unit: str) -> str:
    """Return a value in SI as text in a readable unit."""
    if unit == "1":
        return f"{value:.4g}"
    return str(si(value, unit))


def _limit(claim: MotionClaim) -> str:
    """Return the limit of a claim as text."""
    if not np.isfinite(claim.limit):
        return "-"
    return shown(claim.limit, claim.unit)


def prove_motion(
    robot: Robot, name: str | Path, *, clearance: bool = True, progress: Progress = silent
) -> ProvedMotion:
    """Prove what a robot does along a protocol, at every moment.

    Args:
        robot: the robot.
        name: name or path of the protocol.
        clearance: whether the distances between bodies are bounded as well.
        progress: see `Progress`.

    Raises:
        TwinError: the protocol does not exist, cannot be planned, or has a phase whose motion is a table of samples.
    """
    from twin.api.protocol_plan import plan
    from twin.proof.motion.motion_prover import prove_motion as prove_on_path
    from twin.proof.motion_certificate import motion_certificate
    from twin.reference import ReferenceModel

    protocol = robot.protocol(name)
    robot = robot.bound(protocol)
    trajectory = plan(robot, protocol, progress)
    kinematics = robot.path_kinematics()
    mechanism = robot.mechanism
    path = timed_path(trajectory, protocol, kinematics, mechanism.frame_in_tool(trajectory.frame))
    model = ReferenceModel(mechanism)

    def states(q: Array) -> Mapping[str, Array]:
        return model.link_poses(model.run(q).x)

    proof = prove_on_path(mechanism, path, states, progress)
    progress(f"{protocol.name}: samples", 0.0)
    samples = sampled(model, trajectory, path)
    clearances: tuple[ProvedClearance, ...] = ()
    open_phases: dict[str, str] = {}
    if clearance:
        clearances, open_phases = _clearances(trajectory, kinematics, progress)
    digest = ""
    if robot.files is not None:
        if Path(name).suffix == ".toml":  # as in `Robot.protocol`
            file = Path(name)
        else:
            file = robot.files.protocol(str(name))
        digest = hashlib.sha256(file.read_bytes()).hexdigest()
    motion = ProvedMotion(proof, samples, clearances, digest, (), open_phases)
    findings = (*_findings(motion), *_clearance_findings(motion))
    about = {"robot": robot.name, "protocol": protocol.name, "protocol_sha256": digest, "files": robot.hashes()}
    certificate = motion_certificate(mechanism, path, proof, about)
    return ProvedMotion(proof, samples, clearances, digest, findings, open_phases, certificate)


def timed_path(
    trajectory: Trajectory, protocol: Protocol, kinematics: PathKinematics, T_tool_frame: Array
) -> TimedPath:
    """Return the timed path of a planned trajectory, whose functions the samples are values of.

    Raises:
        ProtocolError: a phase is no path with a computed timing.
    """
    from twin.proof.motion.path import RailGap, TimedPath

    phases = []
    for span in trajectory.phases:
        phases.append(_timed_phase(trajectory.protocol, span, protocol))
    gaps = []
    for gap in kinematics.gaps:
        gaps.append(RailGap(gap.i, gap.j, gap.smallest, gap.name))
    return TimedPath(
        protocol=trajectory.protocol,
        phases=tuple(phases),
        T_tool_frame=T_tool_frame,
        shaft_axis=trajectory.shaft_axis,
        rcm_tolerance=protocol.tolerances.rcm,
        gaps=gaps,
    )


def _timed_phase(name: str, span: PhaseSpan, protocol: Protocol) -> TimedPhase:
    """Return one phase of a trajectory, with the limits of its type."""
    from twin.planning.path import ChebyshevPath
    from twin.proof.motion.path import TimedPhase

    if span.curve is None:
        raise ProtocolError(
            f"{name}: phase '{span.name}' ({span.type}) is a table of samples, and nothing is known between its rows: "
            "prove a protocol without such a phase, or replace it by phases with waypoints"
        )
    joints = span.curve.joints
    if not isinstance(joints, ChebyshevPath):
        raise ProtocolError(
            f"{name}: the path of phase '{span.name}' ({span.type}) is a {type(joints).__name__}; only paths that are "
            "Chebyshev series can be proved"
        )
    limits = protocol.limits[span.type]
    return TimedPhase(
        name=span.name,
        coefficients=joints.coefficients,
        grid=span.curve.grid,
        rates=span.curve.rates,
        start=span.t0,
        duration=span.t1 - span.t0,
        smoothing=span.smoothing,
        rcm=span.rcm,
        enforced=span.rcm_mode != "monitored",
        tip_speed=limits.tip_speed,
        rotation_speed=limits.rotation_speed,
    )


def _clearances(
    trajectory: Trajectory, kinematics: PathKinematics, progress: Progress
) -> tuple[tuple[ProvedClearance, ...], dict[str, str]]:
    """Return (proved distances between the bodies of a robot by phase, {phase without one: reason}).

    The distances are those of the certificate of planning.
    """
    if kinematics.space is None:
        phase_names = [span.name for span in trajectory.phases]
        return (), dict.fromkeys(phase_names, "")

    def keep(Ts: Array, q: Array) -> np.ndarray:
        """Accept every state: the limits are proved elsewhere."""
        return np.ones(len(q), bool)

    progress("clearance: shapes of the bodies", 0.0)
    space = kinematics.space("", _CLEARANCE, keep)
    clearances = []
    open_phases = {}
    for k, span in enumerate(trajectory.phases):
        progress(f"clearance: phase {span.name}", k / len(trajectory.phases))
        assert span.curve is not None  # see `_timed_phase`
        within = _FIRST_DIFFERENCE
        try:
            certificate = space.certify(span.curve.joints, within)
            # nearer bodies need a smaller difference
            if (
                np.isfinite(certificate.found)
                and certificate.found > _LARGEST_BOUND_RATIO * certificate.proven
                and certificate.found > _TOUCHING
            ):
                within = certificate.found * (1.0 - 1.0 / _LARGEST_BOUND_RATIO)
                certificate = space.certify(span.curve.joints, within)
        except MechanismError as problem:
            open_phases[span.name] = str(problem)
            continue
        if np.isfinite(certificate.found):
            clearances.append(ProvedClearance(span.name, certificate.proven, certificate.found, certificate.bodies))
        else:
            open_phases[span.name] = ""
    return tuple(clearances), open_phases


def _clearance_findings(motion: ProvedMotion) -> list[Finding]:
    """Return an error for each phase in which bodies may touch, and a note where no bodies are compared."""
    findings = []
    for clearance in motion.clearances:
        if not clearance.proved > 0:
            names = " and ".join(clearance.bodies)
            text = (
                f"{motion.protocol}: not proved: distance between {names}; the bound is "
                f"{shown(clearance.proved, 'm')}, and {shown(clearance.found, 'm')} was found"
            )
            findings.append(error("prove.open", motion.protocol, text, when=f"phase '{clearance.phase}'"))
    uncompared_phases = []
    for phase, reason in motion.open_phases.items():
        if reason:
            text = f"{motion.protocol}: not proved: distance between bodies; {reason}"
            findings.append(error("prove.open", motion.protocol, text, when=f"phase '{phase}'"))
        else:
            uncompared_phases.append(phase)
    if uncompared_phases:
        text = (
            f"{motion.protocol}: no two bodies are compared in phase {', '.join(uncompared_phases)}: "
            "nothing is said of collisions"
        )
        findings.append(info("prove.clearance", motion.protocol, text))
    return findings


def _findings(motion: ProvedMotion) -> list[Finding]:
    """Return the findings of one protocol."""
    findings = []
    unproved: dict[str, list[str]] = {}
    for claim in motion.proof.claims:
        name = label(claim)
        when = f"phase '{claim.phase}', t = {claim.t:.3f} s"
        if claim.status == "refuted":
            reached = claim.high if claim.smallest else claim.low
            # a smallest value is refuted by an upper end below the limit: "certainly at most"
            relation = "at most" if claim.smallest else "at least"
            limit = shown(claim.limit, claim.unit)
            text = f"{motion.protocol}: {name}: certainly {relation} {shown(reached, claim.unit)}"
            text += f", beyond its limit {limit}"
            size = si(reached, claim.unit)
            findings.append(disagreement("prove.limit", claim.name, text, size, when=when, word=""))
        elif claim.status == "unproved":
            unproved.setdefault(claim.reason, []).append(name)
        value = motion.extreme(claim)
        if value is not None and np.isfinite(claim.bound):
            beyond = claim.low - value if claim.smallest else value - claim.high
            if beyond > _SAMPLE_TOLERANCE * max(1.0, abs(value)):
                text = (
                    f"{motion.protocol}: {name}: a sample is {shown(value, claim.unit)}, beyond the proved bound "
                    f"{shown(claim.bound, claim.unit)}: the path that is proved is not the path that was sampled"
                )
                findings.append(error("prove.inconsistent", claim.name, text, when=when))
    for reason, names in unproved.items():
        text = f"{motion.protocol}: not proved: {', '.join(names[:_NAMED_CLAIMS])}"
        if len(names) > _NAMED_CLAIMS:
            text += f" and {len(names) - _NAMED_CLAIMS} more"
        findings.append(error("prove.open", motion.protocol, f"{text}; {reason}"))
    return findings
