"""The whole judgement of a robot along a trajectory: equations, mechanism, stage, motion, RCM, clearance."""

from __future__ import annotations

import platform
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from twin import spatial
from twin.cad.build import CadModel
from twin.errors import AssemblyError, StageError
from twin.findings import Finding
from twin.kinematics import Kinematics
from twin.mechanism import Mechanism
from twin.protocol import Protocol
from twin.reference import ReferenceModel
from twin.spatial import Array
from twin.trajectory.model import Trajectory
from twin.units import DEG, MM
from twin.validation.compare import Comparison, angles_zyx, compare
from twin.validation.result import PhaseSummary, Report
from twin.validation.rows import Clock, Tolerances, rotation_vectors, row, text

KEY_RATE = 60.0
"""Hz of baked motion."""

CLEARANCE_RATE = 5.0
"""Hz at which distances between parts are measured."""

MIDDLE = 4
"""Of the intervals between keys every fourth is looked into."""

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
    """

    kinematics: Kinematics
    cad: CadModel
    protocol: Protocol
    trajectory: Trajectory
    stage: Path
    tolerances: Tolerances


def judge(case: Case, progress: Progress = lambda label, fraction: None) -> Report:
    """Return the report on one robot along one trajectory."""
    mechanism, trajectory = case.cad.mechanism, case.trajectory
    model = ReferenceModel(mechanism)
    clock = Clock(trajectory.t, _phases(trajectory))
    out = Comparison()
    error: AssemblyError | None = None
    try:
        out = compare(case.kinematics, model, trajectory, clock, case.tolerances, progress)
    except AssemblyError as caught:
        error = caught
        out.findings.append(_cannot_take(mechanism, caught))
    _curves(out, trajectory)
    out.facts["mechanism"] = _mechanism_facts(model)
    if error is None:
        _rcm(case, model, out, clock)
        _stage(case, model, out, clock, progress)
        _baked(case, model, out, clock, progress)
        _clearance(model, out, clock, progress)
    findings = [*case.cad.findings, *trajectory.findings, *out.findings]
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
        "limit_margin": trajectory.limit_margin.min(axis=1),
    }
    out.series |= {f"singularity.{n}": v for n, v in trajectory.singularity.items()}
    out.series |= {f"reach.{n}": v for n, v in trajectory.reach.items()}


def _mechanism_facts(model: ReferenceModel) -> dict[str, str]:
    m = model.mechanism
    mobility = model.mobility(model.home().x)
    redundant = ", ".join(f"{n}: {c}" for n, c in mobility.redundant.items() if c)
    return {
        "bodies, joints": f"{len(m.bodies)} bodies, {len(m.joints)} joints, {len(m.active)} driven",
        "loops closed by": ", ".join(j.name for j in m.loops) or "none: a serial chain",
        "degrees of freedom": f"{mobility.freedom}, from the rank of the constraint Jacobian",
        "redundant constraints": f"{mobility.redundancy} ({redundant})" if mobility.redundancy else "none",
        "read from": m.source,
    }


def _rcm(case: Case, model: ReferenceModel, out: Comparison, clock: Clock) -> None:
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
        other = ReferenceModel(read_stage(case.stage))
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


def _baked(case: Case, model: ReferenceModel, out: Comparison, clock: Clock, progress: Progress) -> None:
    """D against B: link poses baked into a motion layer, read back at their own time codes and between them."""
    from twin.stage.read import read_motion
    from twin.stage.write import Motion, write_motion, write_stage

    progress("baked motion", 0.0)
    mechanism, trajectory = case.cad.mechanism, case.trajectory
    times = key_times(trajectory)
    links = model.link_poses(model.run_poses(trajectory.poses(times)).x)
    with tempfile.TemporaryDirectory(prefix="twin-motion-") as folder:
        home = model.home()
        bare = replace(mechanism, bodies=tuple(replace(b, meshes=()) for b in mechanism.bodies))
        write_stage(bare, Path(folder), home.link_poses, home.q_full)
        files = write_motion(bare, Path(folder), Motion(trajectory.protocol, times, links))
        read_times, read_links = read_motion(files.root)
    at = Clock(times, clock.phases)
    if len(read_times) != len(times) or np.abs(read_times - times).max() > 1e-9:
        out.findings.append(
            Finding("baked.times", "disagreement", "the baked time codes are not those that were meant")
        )
        return
    middle = (0.5 * (times[1:] + times[:-1]))[::MIDDLE]
    between = model.link_poses(model.run_poses(trajectory.poses(middle)).x)
    worst: dict[str, Array] = {}
    for name, Ts in links.items():
        back = read_links.get(name, np.tile(Ts[:1], (len(times), 1, 1)))
        worst = {
            "m": np.maximum(worst.get("m", 0.0), np.linalg.norm(back[:, :3, 3] - Ts[:, :3, 3], axis=1)),
            "rad": np.maximum(worst.get("rad", 0.0), np.linalg.norm(rotation_vectors(Ts, back), axis=1)),
            "mid m": np.maximum(
                worst.get("mid m", 0.0),
                np.linalg.norm(0.5 * (back[1:, :3, 3] + back[:-1, :3, 3])[::MIDDLE] - between[name][:, :3, 3], axis=1),
            ),
        }
    t = case.tolerances
    out.residuals += [
        row("B-D", "baked", "links at their time codes", "m", worst["m"], t.baked_position, at),
        row("B-D", "baked", "links at their time codes", "rad", worst["rad"], t.baked_rotation, at),
        row(
            "B-D",
            "baked",
            "links between keys",
            "m",
            worst["mid m"],
            None,
            Clock(middle, clock.phases),
            note=f"what a player that interpolates {KEY_RATE:g} Hz keys shows",
        ),
    ]
    for r in out.residuals[-3:-1]:
        if not r.agrees:
            out.findings.append(
                Finding(
                    "baked.differs",
                    "disagreement",
                    f"a baked link pose is {text(r.worst, r.unit)} off",
                    where="motion layer",
                    when=f"t = {r.t:.2f} s",
                )
            )


def key_times(trajectory: Trajectory) -> Array:
    """Return the time codes (k,) in s of a baked motion: every 1/60 s, and the end."""
    count = int(np.floor(trajectory.duration * KEY_RATE + 1e-9))
    times = np.arange(count + 1) / KEY_RATE
    return times if trajectory.duration - times[-1] < 1e-9 else np.append(times, trajectory.duration)


def _clearance(model: ReferenceModel, out: Comparison, clock: Clock, progress: Progress) -> None:
    """Judge whether parts run through each other."""
    from twin.reference.clearance import clearance

    run = out.posed
    if run is None or not any(b.meshes for b in model.mechanism.bodies):
        return
    clock = clock.at(out.coarse)
    rows = np.unique(np.linspace(0, len(clock.t) - 1, max(2, int(clock.t[-1] * CLEARANCE_RATE))).astype(int))
    found = clearance(model.mechanism, model.link_poses(run.x[rows]), lambda f: progress("clearance", f))
    out.series |= {"clearance_t": clock.t[rows], "clearance": found.distance}
    k = int(np.argmin(found.distance))
    a, b = found.pair[k]
    when = f"{clock.phase(float(clock.t[rows[k]]))}, t = {clock.t[rows[k]]:.2f} s"
    out.facts["clearance"] = {
        "least distance": f"{found.distance[k] / MM:.2f} mm between {a} and {b}, {when}",
        "method": f"triangle meshes of the CAD (chord tolerance 0.1 mm), {CLEARANCE_RATE:g} Hz, bodies without a "
        "common joint; of jointed bodies, parts that do not mate",
    }
    contacts = [(float(clock.t[rows[k]]), p, q) for k, p, q in found.contacts]
    if found.distance[k] <= 0:
        contacts.insert(0, (float(clock.t[rows[k]]), a, b))
    for t, p, q in contacts:
        out.findings.append(
            Finding(
                "clearance.contact",
                "disagreement",
                f"{p} and {q} run through each other",
                where=f"{p}, {q}",
                when=f"{clock.phase(t)}, t = {t:.2f} s",
                size=0.0,
                unit="mm",
                suggestion="change the parts, or the protocol",
            )
        )


def _environment(mechanism: Mechanism) -> dict[str, str]:
    return {
        "twin": version("twin-robotics"),
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        **{name: version(name) for name in _PACKAGES},
        "input": mechanism.source,
    }
