"""Validate a robot completely along a trajectory: equations, mechanism, stage, motion, RCM, clearance."""

from __future__ import annotations

import contextlib
import platform
from collections.abc import Callable
from importlib.metadata import version

import numpy as np

from twin.core import spatial
from twin.core.errors import AssemblyError, StageError
from twin.core.findings import Finding, Kind, disagreement, info
from twin.core.jobs import Call
from twin.core.processors import usable
from twin.kinematics import Kinematics
from twin.model.mechanism import Mechanism
from twin.planning.protocol import Solver
from twin.planning.trajectory import Trajectory
from twin.reference import ReferenceModel
from twin.validation.case import PARTS, Case, Known, Part
from twin.validation.compare import Comparison, compare, tool_rates
from twin.validation.content import content
from twin.validation.fulcrum import fulcrum
from twin.validation.joint_range import whole_range
from twin.validation.lengths import lengths, put_down
from twin.validation.measures import measures
from twin.validation.motion import (
    MeasuredMotion,
    MotionSamples,
    baked_rows,
    clearance_facts,
    measure,
    samples,
    written_rows,
)
from twin.validation.passage import about_rcm, of_protocol, passage, passive_limits
from twin.validation.plausible import apart
from twin.validation.result import Report
from twin.validation.retimed import OTHERS
from twin.validation.rows import pose_rows, row, text
from twin.validation.trocar_methods import three_methods
from twin.validation.trocars import as_written, through_trocars

Progress = Callable[[str, float], None]

_NO_EQUATIONS = info(
    "equations.none",
    "formula.py",
    "the robot has no equations: only mechanism, stage and motion are checked",
    suggestion="write `inverse` or `forward` in formula.py",
)

_STAGE = Kind("stage.differs", "disagreement", "rebuild the stage with `twin build`", word="tolerance")


def judge(
    case: Case,
    progress: Progress = lambda label, fraction: None,
    parts: frozenset[Part] = PARTS,
    known: Known | None = None,
) -> Report:
    """Run the validation of one robot along one trajectory and return the report.

    `known` are results to reuse. The part "stage" requires the states of the mechanism, computed by the part
    "equations" or included in `known`; without these states, "stage" is skipped.
    """
    mechanism, trajectory = case.cad.mechanism, case.trajectory
    known = known or Known()
    out = known.comparison or Comparison()
    looked = samples(trajectory, case.motion)
    # The baked motion and the clearances do not depend on the equations: another process computes them in parallel.
    # Without meshes there are no clearances, and the start of a process takes longer than the rest. On one processor,
    # a second process only waits for the first one.
    needed = "motion" in parts and known.measured is None
    parallel = needed and usable() > 1 and any(b.meshes for b in mechanism.bodies)
    aside = Call(measure, mechanism, looked, case.written) if parallel else contextlib.nullcontext()
    with aside as beside:
        try:
            if "equations" in parts:
                out = compare(case.kinematics, case.model, trajectory, case.clock, case.tolerances, progress)
                if case.kinematics is not None:
                    rows, found = lengths(case.kinematics, case.cad, case.clock, case.tolerances)
                    out.residuals[:0], out.findings[:] = rows, [*found, *put_down(case.kinematics, found, out.findings)]
                else:
                    out.findings.append(_NO_EQUATIONS)
                about_rcm(case, out)
                through_trocars(case, out)
                passive_limits(case, out)
                passage(case, out)
                if case.kinematics is not None:
                    progress("reach and singularity measures", 0.0)
                    measures(case.kinematics, case.model, case.tolerances, out)
                    progress("joint range", 0.0)
                    whole_range(case.kinematics, case.model, case.tolerances, out)
                    three_methods(case, out)
            if "stage" in parts:
                _stage(case, out, progress)
            if "motion" in parts:
                progress("baked motion, clearance", 0.0)
                measured = beside.result() if beside is not None else known.measured
                _motion(measured or measure(mechanism, looked, case.written), looked, case, out)
        except AssemblyError as error:
            out.findings.append(_cannot_take(mechanism, error))
    _curves(out, trajectory)
    out.facts["mechanism"] = _mechanism_facts(case.model)
    findings = [*case.cad.findings, *(of_protocol(case, out) if "protocol" in parts else ()), *out.findings]
    return _report(case, out, findings, parts)


def _report(case: Case, out: Comparison, findings: list[Finding], parts: frozenset[Part]) -> Report:
    mechanism, trajectory, kin = case.cad.mechanism, case.trajectory, case.kinematics
    return Report(
        robot=mechanism.name,
        title=case.cad.description.title,
        source=kin.formula.source if kin is not None else case.cad.description.source,
        protocol=trajectory.protocol,
        protocol_title=case.protocol.title,
        variants=dict(kin.variants) if kin is not None else {},
        reasons=_reasons(kin) if kin is not None else {},
        residuals=tuple(out.residuals),
        findings=tuple(findings),
        phases=case.clock.phases,
        parameters=(
            *(kin.formula.parameters if kin is not None else ()),
            *mechanism.parameters,
            *case.protocol.parameters(),
            *case.cad.dimensions,
        ),
        facts=out.facts,
        tables=out.tables,
        environment=_environment(case, parts),
        joint_names=trajectory.joint_names,
        series=out.series,
        angles=frozenset(j.name for j in mechanism.joints if j.is_angle),
    )


def _reasons(kin: Kinematics) -> dict[str, str]:
    return {
        f"{e.name}, {variant}": reason
        for e in kin.formula.equations
        if e.stage != "helper"
        for variant, reason in e.reasons.items()
    }


def _cannot_take(mechanism: Mechanism, error: AssemblyError) -> Finding:
    return disagreement(
        "mechanism.no_assembly",
        mechanism.name,
        f"the mechanism cannot reach the tool poses of the protocol: {error}",
        suggestion="the CAD has a smaller workspace than the equations; compare the lengths in `twin info`",
    )


def _curves(out: Comparison, trajectory: Trajectory) -> None:
    v_tool, a_tool = tool_rates(trajectory)
    out.series.setdefault("q", trajectory.q)
    out.series |= {
        "t": trajectory.t,
        "qd": trajectory.qd,
        "qdd": trajectory.qdd,
        "p_tool": trajectory.Ts_base_tool[:, :3, 3],
        "v_tool": v_tool,
        "a_tool": a_tool,
        "angles": np.unwrap(spatial.euler_angles(trajectory.Ts_base_tool[:, :3, :3], "zyx"), axis=0),
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
        **{f"transmission {t.name} (rad, m)": t.equations for t in m.transmissions},
        "read from": m.source,
    }


def _stage(case: Case, out: Comparison, progress: Progress) -> None:
    """Compare the stage's mechanism (C) with the CAD's mechanism (B), both by one solver; estimate rounding errors."""
    from twin.reference.sensitivity import of_rounding
    from twin.usd.check import check_stage, run_usd_validators
    from twin.usd.read import read_stage

    run = out.posed
    if run is None:
        return
    try:
        out.findings += [*check_stage(case.stage), *run_usd_validators(case.stage)]
        if case.written is not None:
            told = {(f.code, f.where) for f in out.findings}
            out.findings += [f for f in check_stage(case.written) if (f.code, f.where) not in told]
            out.findings += as_written(case)
        stage = read_stage(case.stage)
        places = case.protocol.places_of(case.cad.mechanism.trocars)
        stage = stage.with_trocars({n: p for n, p in places.items() if n in stage.trocars})
        out.findings += content(case.cad.mechanism, stage, case.cad.description)
        other = ReferenceModel(stage)
        back = other.run(run.q, progress=lambda f: progress("stage read back", f))
    except (StageError, AssemblyError) as error:
        out.findings.append(disagreement("stage.unreadable", str(case.stage.name), f"stage: {error}"))
        return
    at = case.clock.at(out.coarse)
    spread = of_rounding(case.model, run.x[0])
    note = (
        f"single precision causes an error of {text(spread.expected[0], 'm')} and {text(spread.expected[1], 'rad')} "
        f"(standard deviation; at most {text(spread.bound[0], 'm')}, {text(spread.bound[1], 'rad')})"
    )
    out.facts["stage"] = {"float32 joint frames": note, "most sensitive joint": spread.worst_joint}
    t = case.tolerances
    limits = t.stage_position, t.stage_rotation
    for r in pose_rows("B-C", "tool", run.Ts_base_tool, back.Ts_base_tool, limits, at, note=note):
        what = "the mechanism read from the stage and the mechanism in the CAD have different tool poses"
        out.judge(r, _STAGE, what, case.stage.name)
    for i, loop in enumerate(back.loop_names):
        out.residuals.append(row("C", "loop", loop, "m", back.gaps[:, i, 0], t.stage_position, at))


def _motion(measured: MeasuredMotion, looked: MotionSamples, case: Case, out: Comparison) -> None:
    """Add the findings and curves of the baked motion and of the clearances to `out`."""
    phases = case.clock.phases
    rows, findings = baked_rows(measured, looked, phases, case.tolerances)
    if measured.written is not None:
        more, found = written_rows(measured.written, looked, phases, case.tolerances, case.baked_for_it)
        rows, findings = rows + more, findings + found
    out.residuals += rows
    out.findings += findings
    driver = looked.driver or "reference model (Pinocchio), because equations and compiled loops give no motion"
    out.facts["baked motion"] = {"driven by": driver, "judged by": "reference model (Pinocchio)"}
    out.findings += apart(measured.mates)
    if measured.clearance is not None:
        out.facts["clearance"], contacts = clearance_facts(measured.clearance, looked.sparse, phases)
        out.findings += contacts
        out.series |= {"clearance_t": looked.sparse, "clearance": measured.clearance.distance}


def _environment(case: Case, parts: frozenset[Part]) -> dict[str, str]:
    """Return the machine, and the versions of the packages that planned and judged."""
    mechanism = case.cad.mechanism
    timed_by: list[Solver] = []
    for span in case.trajectory.phases:
        if span.solver is not None and span.solver not in timed_by:
            timed_by.append(span.solver)
    ran = ["numpy", "pin"]
    if case.kinematics is not None or "passes" in timed_by:
        ran += ["casadi", "llvmlite"]
    if "motion" in parts and any(body.meshes for body in mechanism.bodies):
        ran.append("coal")
    if parts & {"stage", "motion"}:
        ran.append("usd-core")
    if case.cad.description.step is not None:
        ran.append("cascadio")
    judges = [OTHERS[solver][0] for solver in timed_by] if "protocol" in parts else []
    if "toppra" in timed_by or "toppra" in judges:
        ran.append("toppra")
    timing = f"by {' and '.join(timed_by)}" if timed_by else "given by samples"
    if judges:
        timing += f", judged by {' and '.join(judges)}"
    return {
        "twin": version("twin-robotics"),
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        **{name: version(name) for name in ran},
        "timing": timing,
        "input": mechanism.source,
    }
