"""The whole judgement of a robot along a trajectory: equations, mechanism, stage, motion, RCM, clearance."""

from __future__ import annotations

import contextlib
import platform
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import numpy as np

from twin import spatial
from twin.cad.build import CadModel
from twin.errors import AssemblyError, StageError
from twin.findings import Finding
from twin.kinematics import Kinematics
from twin.mechanism import Mechanism
from twin.protocol import Protocol
from twin.reference import ReferenceModel
from twin.trajectory.check import check
from twin.trajectory.model import PathKinematics, Trajectory
from twin.units import DEG, MM
from twin.validation.beside import Beside
from twin.validation.compare import Comparison, angles_zyx, compare
from twin.validation.consistent import fixes
from twin.validation.content import content
from twin.validation.fulcrum import fulcrum
from twin.validation.lengths import lengths
from twin.validation.margins import margins, of_mechanism
from twin.validation.motion import Measured, Samples, baked_rows, clearance_facts, measure, samples, written_rows
from twin.validation.result import PhaseSummary, Report
from twin.validation.rows import Clock, Tolerances, rotation_vectors, row, text
from twin.validation.shaft import between_samples
from twin.validation.timing import timing

_PACKAGES = ("numpy", "casadi", "pin", "coal", "usd-core", "cascadio", "toppra")

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Case:
    """What is judged.

    Attributes:
        kinematics: the equations, in the variants to judge.
        cad: the mechanism from the CAD and what reading it found.
        protocol, trajectory: along what.
        stage: root layer of the USD stage that holds the same robot.
        tolerances: what counts as agreement.
        paths: the robot as planning knows it; None: the trajectory's own findings are taken for its limits.
        baked_for_it: a motion that lies beside the stage was made for this very trajectory, and has to be it.
    """

    kinematics: Kinematics
    cad: CadModel
    protocol: Protocol
    trajectory: Trajectory
    stage: Path
    tolerances: Tolerances
    paths: PathKinematics | None = None
    baked_for_it: bool = False

    @property
    def written(self) -> Path | None:
        """The stage with the protocol's motion baked in it, if there is one beside the robot's."""
        path = self.stage.with_name(f"{self.stage.stem}_{self.trajectory.protocol}{self.stage.suffix}")
        return path if path.is_file() else None


Part = Literal["equations", "stage", "motion"]
"""What can be judged by itself: the equations and the protocol; the stage; the baked motion and clearances."""

PARTS: frozenset[Part] = frozenset(("equations", "stage", "motion"))


def judge(case: Case, progress: Progress = lambda label, fraction: None, parts: frozenset[Part] = PARTS) -> Report:
    """Return the report on one robot along one trajectory; `parts` leaves some of the judgement out."""
    mechanism, trajectory = case.cad.mechanism, case.trajectory
    model = ReferenceModel(mechanism)
    clock = Clock(trajectory.t, _phases(trajectory))
    out = Comparison()
    looked = samples(trajectory)
    # What needs no equations is measured on a second core meanwhile.
    aside = Beside(measure, mechanism, looked, case.written) if "motion" in parts else contextlib.nullcontext()
    with aside as beside:
        try:
            out = compare(case.kinematics, model, trajectory, clock, case.tolerances, progress)
        except AssemblyError as error:
            out.findings.append(_cannot_take(mechanism, error))
        else:
            rows, found = lengths(case.kinematics, case.cad, clock, case.tolerances)
            out.residuals[:0], out.findings[:0] = rows, found
            _rcm(case, out, clock)
            _passive_limits(model, out, clock)
            _passage(case, model, out, clock)
            if "stage" in parts:
                _stage(case, model, out, clock, progress)
            if beside is not None:
                progress("baked motion, clearance", 0.0)
                _motion(beside.result(), looked, case, out, clock)
    _curves(out, trajectory)
    out.facts["mechanism"] = _mechanism_facts(model)
    findings = [*case.cad.findings, *_protocol(case, out), *out.findings]
    formula = case.kinematics.formula
    return Report(
        robot=mechanism.name,
        title=case.cad.description.title,
        source=formula.source,
        protocol=trajectory.protocol,
        protocol_title=case.protocol.title,
        variants=dict(case.kinematics.variants),
        reasons=_reasons(case.kinematics),
        residuals=tuple(out.residuals),
        findings=tuple(findings),
        phases=clock.phases,
        parameters=(
            *formula.parameters,
            *mechanism.parameters,
            *case.protocol.parameters(),
            *case.cad.dimensions,
        ),
        facts=out.facts,
        environment=_environment(mechanism),
        joint_names=trajectory.joint_names,
        series=out.series,
    )


def _phases(trajectory: Trajectory) -> tuple[PhaseSummary, ...]:
    return tuple(
        PhaseSummary(
            p.name,
            p.type,
            p.t0,
            p.t1,
            None if p.rcm is None else (float(p.rcm[0]), float(p.rcm[1]), float(p.rcm[2])),
            p.rcm_mode or "",
        )
        for p in trajectory.phases
    )


def _reasons(kin: Kinematics) -> dict[str, str]:
    return {
        f"{e.name}, {variant}": reason
        for e in kin.formula.equations
        if e.stage != "helper"
        for variant, reason in e.reasons.items()
    }


def _cannot_take(mechanism: Mechanism, error: AssemblyError) -> Finding:
    return Finding(
        "mechanism.no_assembly",
        "disagreement",
        f"the mechanism cannot take the tool poses of the protocol: {error}",
        where=mechanism.name,
        suggestion="the CAD does not reach where the equations do; compare the lengths in `info`",
    )


def _curves(out: Comparison, trajectory: Trajectory) -> None:
    lever = trajectory.Ts_base_tool[:, :3, 3] - trajectory.Ts_base_frame[:, :3, 3]
    w, dw = trajectory.angular_velocity, trajectory.angular_acceleration
    out.series.setdefault("q", trajectory.q)
    out.series |= {
        "t": trajectory.t,
        "qd": trajectory.qd,
        "qdd": trajectory.qdd,
        "p_tool": trajectory.Ts_base_tool[:, :3, 3],
        "v_tool": trajectory.tip_velocity + np.cross(w, lever),
        "a_tool": trajectory.tip_acceleration + np.cross(dw, lever) + np.cross(w, np.cross(w, lever)),
        "angles": np.unwrap(angles_zyx(trajectory.Ts_base_tool), axis=0),
        "rcm_error": trajectory.rcm_error,
        "fulcrum": fulcrum(trajectory),
        "limit_margin": trajectory.limit_margin.min(axis=1),
    }
    out.series |= {f"singularity.{n}": v for n, v in trajectory.singularity.items()}
    out.series |= {f"reach.{n}": v for n, v in trajectory.reach.items()}


def _mechanism_facts(model: ReferenceModel) -> dict[str, str]:
    m = model.mechanism
    mobility = model.mobility(model.home().x)
    return {
        "bodies, joints": f"{len(m.bodies)} bodies, {len(m.joints)} joints, {len(m.active)} driven",
        "loops closed by": ", ".join(j.name for j in m.loops) or "none: a serial chain",
        "degrees of freedom": f"{mobility.freedom}, from the rank of the constraint Jacobian",
        "redundant constraints": f"{mobility.redundancy} ({mobility.describe()})" if mobility.redundancy else "none",
        "read from": m.source,
    }


def _rcm(case: Case, out: Comparison, clock: Clock) -> None:
    """Judge the mechanism's own motion about the RCM, from registration to withdrawal."""
    run, trajectory, mechanism = out.driven, case.trajectory, case.cad.mechanism
    if run is None or any(r.consequence_of for r in out.residuals if r.quantity == "tool"):
        return
    tool, frame = mechanism.frame(mechanism.tool), mechanism.frame(trajectory.frame)
    T_tool_frame = spatial.inverse(tool.T_body_frame) @ frame.T_body_frame
    Ts = run.Ts_base_tool @ T_tool_frame
    for span in trajectory.phases:
        if span.rcm is None:
            continue
        rows = np.arange(span.start, span.stop + 1)
        axis = Ts[rows, :3, :3] @ trajectory.shaft_axis
        missed = spatial.point_to_line(span.rcm, Ts[rows, :3, 3], axis)
        enforced = span.rcm_mode != "monitored"
        tolerance = case.tolerances.rcm if enforced else case.protocol.tolerances.rcm
        r = row(
            "B",
            "rcm",
            span.name,
            "m",
            missed,
            tolerance,
            clock.at(rows),
            note=f"{'enforced' if enforced else 'monitored'}, on the mechanism driven by the equations",
        )
        out.residuals.append(r)
        if not r.agrees and enforced:
            out.findings.append(
                Finding(
                    "rcm.mechanism",
                    "disagreement",
                    f"the mechanism's shaft passes the enforced RCM at {text(r.worst, 'm')}",
                    where="RCM",
                    when=f"{span.name}, t = {r.t:.2f} s",
                    size=r.worst / MM,
                    unit="mm",
                    limit=tolerance / MM,
                )
            )


def _passive_limits(model: ReferenceModel, out: Comparison, clock: Clock) -> None:
    """Judge joints that nobody drives: their ranges, and the cones of spherical joints."""
    run = out.posed
    joints = [j for j in model.mechanism.joints if not j.active and (j.cone is not None or j.limits is not None)]
    if run is None or not joints:
        return
    links = model.link_poses(run.x)
    at = clock.at(out.coarse)
    left: dict[str, str] = {}
    for joint in joints:
        if joint.cone is not None:
            z0 = (links[joint.parent] @ joint.T_parent_joint)[:, :3, 2]
            z1 = (links[joint.child] @ joint.T_child_joint)[:, :3, 2]
            tilt = np.arctan2(np.linalg.norm(np.cross(z0, z1), axis=1), np.sum(z0 * z1, axis=1))
            margin, unit, scale = joint.cone - tilt, "deg", DEG
        elif joint.name in run.q_passive and joint.limits is not None:
            q = run.q_passive[joint.name]
            margin = np.minimum(q - joint.limits[0], joint.limits[1] - q)
            unit, scale = ("deg", DEG) if joint.is_angle else ("mm", MM)
        else:
            continue
        k = int(np.argmin(margin))
        when = f"{at.phase(float(at.t[k]))}, t = {at.t[k]:.2f} s"
        left[joint.name] = f"{margin[k] / scale:.1f} {unit} left, {when}"
        if margin[k] < 0:
            out.findings.append(
                Finding(
                    "limit.passive",
                    "disagreement",
                    f"passive joint {joint.name} is turned {-margin[k] / scale:.2f} {unit} beyond its limit",
                    where=joint.name,
                    when=when,
                    size=-margin[k] / scale,
                    unit=unit,
                    limit=0.0,
                    suggestion="change the protocol, or the joint",
                )
            )
    out.facts["limits of passive joints"] = left


def _passage(case: Case, model: ReferenceModel, out: Comparison, clock: Clock) -> None:
    """Judge what the mechanism does between samples, and how near it comes to its singularities."""
    if out.driven is not None and not any(r.consequence_of for r in out.residuals if r.quantity == "tool"):
        rows, found = between_samples(model, case.trajectory, case.protocol.tolerances.rcm, clock)
        out.residuals += rows
        out.findings += found
    if out.posed is not None:
        facts, found, curves = of_mechanism(model, out.posed, out.coarse, clock)
        out.facts["margins along the path"] = facts
        out.findings += found
        out.series |= curves


def _protocol(case: Case, out: Comparison) -> list[Finding]:
    """Return what is to be said of the motion itself: what planning found, and what its samples say by themselves."""
    trajectory, mechanism = case.trajectory, case.cad.mechanism
    facts, found = timing(trajectory, mechanism, case.protocol)
    out.facts["timing, from the samples alone"] = facts
    said = list(trajectory.findings)
    if case.paths is None or any(f.code in ("timing.clock", "timing.phases") for f in found):
        return [*said, *found]
    # A trajectory may be older than the robot, or come from elsewhere: its own findings are not believed.
    said += [f for f in check(trajectory, case.protocol, case.paths) if f not in said]
    clock = Clock(trajectory.t, _phases(trajectory))
    left = margins(trajectory, mechanism, case.paths, clock)
    out.facts["margins along the path"] = left | out.facts.get("margins along the path", {})
    tool, frame = mechanism.frame(mechanism.tool), mechanism.frame(trajectory.frame)
    ways, notes = fixes(case.protocol, trajectory, case.paths, spatial.inverse(tool.T_body_frame) @ frame.T_body_frame)
    if ways:
        out.facts["ways to keep the RCM"] = ways
    return [*said, *found, *notes]


def _stage(case: Case, model: ReferenceModel, out: Comparison, clock: Clock, progress: Progress) -> None:
    """C against B: the same solver on the stage read back, and what single precision explains."""
    from twin.reference.sensitivity import of_rounding
    from twin.stage.check import check_stage, run_usd_validators
    from twin.stage.read import read_stage

    run = out.posed
    if run is None:
        return
    try:
        out.findings += [*check_stage(case.stage), *run_usd_validators(case.stage)]
        if case.written is not None:
            told = {(f.code, f.where) for f in out.findings}
            out.findings += [f for f in check_stage(case.written) if (f.code, f.where) not in told]
        stage = read_stage(case.stage)
        if case.protocol.trocar is not None:
            stage = stage.with_trocar(case.protocol.trocar)
        out.findings += content(case.cad.mechanism, stage, case.cad.description)
        other = ReferenceModel(stage)
        back = other.run(run.q, progress=lambda f: progress("stage read back", f))
    except (StageError, AssemblyError) as error:
        out.findings.append(Finding("stage.unreadable", "disagreement", f"stage: {error}", where=str(case.stage.name)))
        return
    at = clock.at(out.coarse)
    Ts = run.Ts_base_tool
    spread = of_rounding(model, run.x[0])
    note = (
        f"single precision explains {text(spread.expected[0], 'm')} and {text(spread.expected[1], 'rad')} "
        f"(at most {text(spread.bound[0], 'm')}, {text(spread.bound[1], 'rad')})"
    )
    out.facts["stage"] = {"float32 joint frames": note, "most sensitive joint": spread.worst_joint}
    t = case.tolerances
    for name, unit, difference, tolerance in (
        ("tool", "m", back.Ts_base_tool[:, :3, 3] - Ts[:, :3, 3], t.stage_position),
        ("tool", "rad", rotation_vectors(Ts, back.Ts_base_tool), t.stage_rotation),
    ):
        r = row("B-C", "tool", name, unit, difference, tolerance, at, note=note)
        out.residuals.append(r)
        if not r.agrees:
            out.findings.append(
                Finding(
                    "stage.differs",
                    "disagreement",
                    f"the stage read back moves its tool {text(r.worst, unit)} from the CAD's mechanism",
                    where=case.stage.name,
                    when=f"{r.phase}, t = {r.t:.2f} s",
                    size=r.worst / (MM if unit == "m" else DEG),
                    unit="mm" if unit == "m" else "deg",
                    limit=tolerance / (MM if unit == "m" else DEG),
                    suggestion="rebuild the stage with `twin build`",
                )
            )
    for i, loop in enumerate(back.loop_names):
        out.residuals.append(row("C", "loop", loop, "m", back.gaps[:, i, 0], t.stage_position, at))


def _motion(measured: Measured, looked: Samples, case: Case, out: Comparison, clock: Clock) -> None:
    """Add what was measured beside the comparison."""
    rows, findings = baked_rows(measured, looked, clock.phases, case.tolerances)
    if measured.written is not None:
        more, found = written_rows(measured.written, looked, clock.phases, case.tolerances, case.baked_for_it)
        rows, findings = rows + more, findings + found
    out.residuals += rows
    out.findings += findings
    if measured.clearance is not None:
        out.facts["clearance"], contacts = clearance_facts(measured.clearance, looked.sparse, clock.phases)
        out.findings += contacts
        out.series |= {"clearance_t": looked.sparse, "clearance": measured.clearance.distance}


def _environment(mechanism: Mechanism) -> dict[str, str]:
    return {
        "twin": version("twin-robotics"),
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        **{name: version(name) for name in _PACKAGES},
        "input": mechanism.source,
    }
