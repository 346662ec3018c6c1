"""Validate a robot completely along a trajectory: equations, mechanism, stage, motion, RCM, clearance."""

from __future__ import annotations

import contextlib
import platform
from importlib.metadata import version

from twin.core.errors import AssemblyError, StageError
from twin.core.findings import Finding, Kind, disagreement, info
from twin.core.jobs import Call
from twin.core.progress import Progress, silent
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.kinematics import Kinematics
from twin.model.mechanism import Mechanism
from twin.planning.protocol import Solver
from twin.reference import ReferenceModel
from twin.validation.baked_motion import (
    MeasuredMotion,
    MotionSamples,
    baked_rows,
    clearance_facts,
    existing_motion_rows,
    measure_motion,
    parts_apart,
    sampled_motion,
    written_trocars,
)
from twin.validation.case import PARTS, Case, KnownResults, Part
from twin.validation.checked_plan import OTHERS
from twin.validation.equation_checks import compare, tool_rates
from twin.validation.equations_comparison import EquationsComparison
from twin.validation.joint_range import whole_range
from twin.validation.lengths import check_lengths, with_length_causes
from twin.validation.margins import check_equations_margins
from twin.validation.report_curves import trajectory_curves
from twin.validation.residual_rows import display_text, pose_rows, row
from twin.validation.result import Report
from twin.validation.stage_content import compare_content
from twin.validation.trajectory_checks import (
    check_between_samples,
    check_passive_limits,
    check_protocol,
    check_rcm,
    check_shafts_through_trocars,
)
from twin.validation.trocar_methods import compare_three_methods

_NO_EQUATIONS = info(
    "equations.none",
    "formula.py",
    "the robot has no equations: only mechanism, stage and motion are checked",
    suggestion="write `inverse` or `forward` in formula.py",
)

_STAGE_DIFFERS = Kind("stage.differs", "disagreement", "rebuild the stage with `twin build`", word="tolerance")


def judge(
    case: Case,
    progress: Progress = silent,
    parts: frozenset[Part] = PARTS,
    known: KnownResults | None = None,
) -> Report:
    """Run the validation of one robot along one trajectory and return the report.

    `known` are results to reuse. The part "stage" requires the states of the mechanism, computed by the part
    "equations" or included in `known`; without these states, "stage" is skipped.
    """
    mechanism = case.cad.mechanism
    trajectory = case.trajectory
    known = known or KnownResults()
    comparison = known.comparison or EquationsComparison()
    motion_samples = sampled_motion(trajectory, case.motion)
    # The baked motion and the clearances do not depend on the equations: another process computes them in parallel.
    # Without meshes there are no clearances, and the start of a process takes longer than the rest.
    measuring: contextlib.AbstractContextManager[Call | None] = contextlib.nullcontext()
    if "motion" in parts and known.measured is None and _has_meshes(mechanism):
        measuring = Call(measure_motion, mechanism, motion_samples, case.written)
    with measuring as call:
        try:
            if "equations" in parts:
                comparison = compare(
                    case.kinematics,
                    case.model,
                    trajectory=trajectory,
                    clock=case.clock,
                    tolerances=case.tolerances,
                    progress=progress,
                )
                _judge_equations(case, comparison, progress)
            if "stage" in parts:
                _judge_stage(case, comparison, progress)
            if "motion" in parts:
                progress("baked motion, clearance", 0.0)
                measured = known.measured
                if call is not None:
                    measured = call.result()
                if measured is None:
                    measured = measure_motion(mechanism, motion_samples, case.written)
                _judge_motion(measured, motion_samples, case, comparison)
        except AssemblyError as error:
            comparison.findings.append(_unreachable_poses(mechanism, error))
    v_tool, a_tool = tool_rates(trajectory)
    comparison.series.setdefault("q", trajectory.q)
    comparison.series |= {**trajectory_curves(trajectory), "v_tool": v_tool, "a_tool": a_tool}
    comparison.facts["mechanism"] = _mechanism_facts(case.model)
    findings = [*case.cad.findings]
    if "protocol" in parts:
        findings += check_protocol(case, comparison)
    findings += comparison.findings
    return _report(case, comparison, findings, parts)


def _has_meshes(mechanism: Mechanism) -> bool:
    """Return whether a body has a shape, without which there are no clearances."""
    return any(body.meshes for body in mechanism.bodies)


def _judge_equations(case: Case, comparison: EquationsComparison, progress: Progress) -> None:
    """Run the judges of the equations and of the RCM, and add their rows and findings to `comparison`."""
    kin = case.kinematics
    if kin is None:
        comparison.findings.append(_NO_EQUATIONS)
    else:
        rows, findings = check_lengths(kin, case.cad, case.clock, case.tolerances)
        # lengths first: they are inputs of the equations
        comparison.residuals[:0] = rows
        comparison.findings[:] = [*findings, *with_length_causes(kin, findings, comparison.findings)]
    check_rcm(case, comparison)
    check_shafts_through_trocars(case, comparison)
    check_passive_limits(case, comparison)
    check_between_samples(case, comparison)
    if kin is not None:
        progress("reach and singularity measures", 0.0)
        check_equations_margins(kin, case.model, case.tolerances, comparison)
        progress("joint range", 0.0)
        whole_range(kin, case.model, case.tolerances, comparison)
        compare_three_methods(case, comparison)


def _report(case: Case, comparison: EquationsComparison, findings: list[Finding], parts: frozenset[Part]) -> Report:
    """Return the report: what the judges added to `comparison`, with the data of robot and protocol."""
    mechanism = case.cad.mechanism
    trajectory = case.trajectory
    kin = case.kinematics
    source = case.cad.description.source
    variants: dict[str, str] = {}
    reasons: dict[str, str] = {}
    parameters: list[Parameter] = []
    if kin is not None:
        source = kin.formula.source
        variants = dict(kin.variants)
        reasons = _variant_reasons(kin)
        parameters += kin.formula.parameters
    parameters += mechanism.parameters
    of_protocol = tuple(case.protocol.parameters())
    parameters += of_protocol
    parameters += case.cad.dimensions
    return Report(
        robot=mechanism.name,
        title=case.cad.description.title,
        source=source,
        protocol=trajectory.protocol,
        protocol_title=case.protocol.title,
        variants=variants,
        reasons=reasons,
        residuals=tuple(comparison.residuals),
        findings=tuple(findings),
        phases=case.clock.phases,
        parameters=tuple(parameters),
        of_protocol=of_protocol,
        facts=comparison.facts,
        tables=comparison.tables,
        environment=_environment_facts(case, parts),
        joint_names=trajectory.joint_names,
        series=comparison.series,
        angles=frozenset(joint.name for joint in mechanism.joints if joint.is_angle),
    )


def _variant_reasons(kin: Kinematics) -> dict[str, str]:
    """Return {"equation, variant": how and why the variant differs from the printed equation}; without helpers."""
    reasons: dict[str, str] = {}
    for equation in kin.formula.equations:
        if equation.stage == "helper":
            continue
        for variant, reason in equation.reasons.items():
            reasons[f"{equation.name}, {variant}"] = reason
    return reasons


def _unreachable_poses(mechanism: Mechanism, error: AssemblyError) -> Finding:
    """Return the finding on a mechanism that cannot be assembled at the tool poses of the protocol."""
    return disagreement(
        "mechanism.no_assembly",
        mechanism.name,
        f"the mechanism cannot reach the tool poses of the protocol: {error}",
        suggestion="the CAD has a smaller workspace than the equations; compare the lengths in `twin info --all`",
    )


def _mechanism_facts(model: ReferenceModel) -> dict[str, str]:
    """Return the facts on the mechanism by name: numbers of its parts, loops, mobility, transmissions, source."""
    mechanism = model.mechanism
    mobility = model.mobility(model.home().x)
    redundant = "none"
    if mobility.redundancy:
        redundant = f"{mobility.redundancy} ({mobility.describe()})"
    facts = {
        "bodies, joints": (
            f"{len(mechanism.bodies)} bodies, {len(mechanism.joints)} joints, {len(mechanism.active)} driven"
        ),
        "loops closed by": ", ".join(joint.name for joint in mechanism.loops) or "none: a serial chain",
        "degrees of freedom": f"{mobility.freedom}, from the rank of the constraint Jacobian",
        "redundant constraints": redundant,
    }
    for transmission in mechanism.transmissions:
        facts[f"transmission {transmission.name} (rad, m)"] = transmission.equations
    facts["read from"] = mechanism.source
    return facts


def _judge_stage(case: Case, comparison: EquationsComparison, progress: Progress) -> None:
    """Compare the stage's mechanism (C) with the CAD's mechanism (B), both by one solver; estimate rounding errors."""
    from twin.reference.sensitivity import of_rounding
    from twin.usd.read import read_stage

    run = comparison.posed
    if run is None:
        return
    try:
        _check_files(case, comparison)
        stage = read_stage(case.stage)
        # the protocol may move trocars; the stage is built without a protocol
        trocars: dict[str, Array] = {}
        for name, place in case.protocol.places_of(case.cad.mechanism.trocars).items():
            if name in stage.trocars:
                trocars[name] = place
        stage = stage.with_trocars(trocars)
        comparison.findings += compare_content(case.cad.mechanism, stage, case.cad.description)
        stage_model = ReferenceModel(stage)
        back = stage_model.run(run.q, progress=lambda part: progress("stage read back", part))
    except (StageError, AssemblyError) as error:
        comparison.findings.append(disagreement("stage.unreadable", str(case.stage.name), f"stage: {error}"))
        return
    spread = of_rounding(case.model, run.x[0])
    position_std, rotation_std = spread.expected
    position_bound, rotation_bound = spread.bound
    note = (
        f"single precision causes an error of {display_text(position_std, 'm')} and "
        f"{display_text(rotation_std, 'rad')} (standard deviation; at most {display_text(position_bound, 'm')}, "
        f"{display_text(rotation_bound, 'rad')})"
    )
    comparison.facts["stage"] = {"float32 joint frames": note, "most sensitive joint": spread.worst_joint}
    clock = case.clock.at(comparison.coarse)
    limits = (case.tolerances.stage_position, case.tolerances.stage_rotation)
    for residual in pose_rows(
        "B-C", "tool", Ts=run.Ts_base_tool, others=back.Ts_base_tool, limits=limits, clock=clock, note=note
    ):
        what = "the mechanism read from the stage and the mechanism in the CAD have different tool poses"
        comparison.judge(residual, _STAGE_DIFFERS, what, case.stage.name)
    for i, loop in enumerate(back.loop_names):
        gaps = back.gaps[:, i, 0]
        comparison.residuals.append(
            row("C", "loop", loop, unit="m", differences=gaps, tolerance=case.tolerances.stage_position, clock=clock)
        )


def _check_files(case: Case, comparison: EquationsComparison) -> None:
    """Add the findings on the files of the stage, each once, and of the stage with the baked motion, if it exists."""
    from twin.usd.check import check_stage, run_usd_validators

    comparison.findings += [*check_stage(case.stage), *run_usd_validators(case.stage)]
    if case.written is None:
        return
    # the stage with the motion contains the robot's stage, so that it has the same faults again
    reported = {(finding.code, finding.where) for finding in comparison.findings}
    for finding in check_stage(case.written):
        if (finding.code, finding.where) not in reported:
            comparison.findings.append(finding)
    comparison.findings += written_trocars(case.written, case.cad.mechanism, case.baked_for_it)


def _judge_motion(
    measured: MeasuredMotion, motion_samples: MotionSamples, case: Case, comparison: EquationsComparison
) -> None:
    """Add the findings and curves of the baked motion and of the clearances to `comparison`."""
    phases = case.clock.phases
    rows, findings = baked_rows(measured, motion_samples, phases, case.tolerances)
    comparison.residuals += rows
    comparison.findings += findings
    if measured.written is not None:
        rows, findings = existing_motion_rows(
            measured.written, motion_samples, phases=phases, tolerances=case.tolerances, due=case.baked_for_it
        )
        comparison.residuals += rows
        comparison.findings += findings
    driver = motion_samples.driver or "reference model (Pinocchio), because equations and compiled loops give no motion"
    comparison.facts["baked motion"] = {"driven by": driver, "judged by": "reference model (Pinocchio)"}
    comparison.findings += parts_apart(measured.mates)
    if measured.clearance is not None:
        comparison.facts["clearance"], contacts = clearance_facts(measured.clearance, motion_samples.sparse, phases)
        comparison.findings += contacts
        comparison.series["clearance_t"] = motion_samples.sparse
        comparison.series["clearance"] = measured.clearance.distance


def _environment_facts(case: Case, parts: frozenset[Part]) -> dict[str, str]:
    """Return the machine, and the versions of the packages that planned and judged."""
    mechanism = case.cad.mechanism
    timed_by: list[Solver] = []
    for span in case.trajectory.phases:
        if span.solver is not None and span.solver not in timed_by:
            timed_by.append(span.solver)
    judges: list[str] = []
    if "protocol" in parts:
        for solver in timed_by:
            judges.append(OTHERS[solver][0])
    packages = ["numpy", "pin"]
    if case.kinematics is not None or "passes" in timed_by:
        packages += ["casadi", "llvmlite"]
    if "motion" in parts and _has_meshes(mechanism):
        packages.append("coal")
    if parts & {"stage", "motion"}:
        packages.append("usd-core")
    if case.cad.description.step is not None:
        packages.append("cascadio")
    if "toppra" in timed_by or "toppra" in judges:
        packages.append("toppra")
    timing = "given by samples"
    if timed_by:
        timing = f"by {' and '.join(timed_by)}"
    if judges:
        timing += f", judged by {' and '.join(judges)}"
    return {
        "twin": version("twin-robotics"),
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        **{package: version(package) for package in packages},
        "timing": timing,
        "input": mechanism.source,
    }
