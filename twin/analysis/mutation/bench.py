"""Prepare a correct robot, and check single seeded faults with the validator, fast parts first.

A fault is caught if a part of the validator reports a new finding, one that is not reported for the correct robot; if
this finding is only a warning, the fault is warned. A fault that no fast part catches is checked by all parts before it
counts as missed, unless it has no effect: then it is equivalent.
"""

from __future__ import annotations

import contextlib
import shutil
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from twin.analysis.mutation.equivalent import same_equations, same_motion, same_protocol, same_samples, same_stage
from twin.analysis.mutation.fault import Detection, SeededFault, State
from twin.api.equation_checks import PLACEMENT_FACTOR
from twin.api.robot import Robot
from twin.cad.build import CadModel, read_mechanism
from twin.core.errors import TwinError
from twin.core.findings import SEVERITIES, Finding
from twin.core.findings import error as error_finding
from twin.core.progress import silent
from twin.core.spatial import Array
from twin.exchange.formats.usd.write import bake, baked_times, write_usd
from twin.model.mechanism import Mechanism
from twin.planning.link_motion import LinkMotion
from twin.planning.plan import plan
from twin.planning.protocol import Protocol
from twin.planning.trajectory import Trajectory
from twin.reference import ReferenceModel
from twin.validation.baked_motion import MeasuredMotion, existing_motion, measure_motion, sampled_motion
from twin.validation.case import PARTS, Case, KnownResults, Part, phase_summaries
from twin.validation.equation_checks import compare
from twin.validation.equations_comparison import EquationsComparison
from twin.validation.judge import judge
from twin.validation.residual_rows import SampleClock, Tolerances
from twin.validation.result import Report

SAMPLE_TIME = 0.04
"""Time in s between samples of the motion: small enough for all checks, large enough for many runs."""

# single parts of the validator, which run before all parts do
_PROTOCOL: frozenset[Part] = frozenset(("protocol",))
_EQUATIONS: frozenset[Part] = frozenset(("equations",))
_STAGE: frozenset[Part] = frozenset(("stage",))
_MOTION: frozenset[Part] = frozenset(("motion",))


class Bench:
    """A correct robot, a motion of it with coarse samples, and a stage with this motion in a separate folder.

    Attributes:
        protocol, protocol_file: the protocol of the motion, and its file.
        robot: the correct robot, with the trocars of the protocol.
        folder: folder for stages, and for the files of faults.
        paths, kin: the equations, as the planner and as the validator use them.
        trajectory: the motion.
        weighed: the mechanism with masses, without the trocars of the protocol.
        stage, still_stage: root layers of the stage with the motion, and of one without motion.
        cad: the CAD of the robot, with the trocars of the protocol.
        tolerances: tolerances of the validator.
    """

    def __init__(self, robot: Robot, protocol: str | None, folder: Path) -> None:
        """Prepare the correct robot (no seeded fault): plan its motion, compute masses and build the stage.

        The robot is validated at the first use of `correct_report`.

        Raises:
            TwinError: the robot has no equations or CAD, or its protocol cannot be carried out.
        """
        self.protocol = robot.protocol(protocol)
        self.robot = robot.bound(self.protocol)
        self.folder = folder
        self.protocol_file = self._file_of(robot, protocol)
        self.paths = self.robot.path_kinematics()
        self.kin = self.robot.kinematics()
        self.trajectory = self.planned(self.protocol)
        assert robot.files is not None
        self.weighed = read_mechanism(robot.files.description).mechanism
        self.stage = self.write_stage(self.weighed, self.robot.mechanism, folder / "stage")
        # A stage without motion: with the correct motion on the stage, every changed motion would cause a finding.
        still_folder = folder / "still"
        still_folder.mkdir()
        self.still_stage = write_usd(self.weighed, (), still_folder)[0]
        self.cad: CadModel = replace(self.robot.cad, mechanism=self.robot.mechanism)
        accuracy = PLACEMENT_FACTOR * self.cad.placement_loss  # as in `validate`
        self.tolerances = Tolerances().widened(accuracy, self.cad.mechanism.link_length)

    def _file_of(self, robot: Robot, protocol: str | None) -> Path:
        """Return the file of the protocol; `protocol` is its name or file, None for the default one."""
        if protocol is not None and Path(protocol).suffix == ".toml":
            return Path(protocol)
        if robot.files is None:
            raise TwinError(f"{robot.name} is a USD stage: it has no equations to change")
        return robot.files.protocol(self.protocol.name)

    def planned(self, protocol: Protocol, robot: Robot | None = None) -> Trajectory:
        """Return the trajectory of a protocol for a robot (default: the correct one), sampled every `SAMPLE_TIME`."""
        if robot is None:
            paths = self.paths
            mechanism = self.robot.mechanism
        else:
            paths = robot.path_kinematics()
            mechanism = robot.mechanism
        T_tool_frame = mechanism.frame_in_tool(protocol.frame)
        return plan(protocol, paths, T_tool_frame=T_tool_frame, dt=SAMPLE_TIME)

    def write_stage(self, mechanism: Mechanism, bound: Mechanism, folder: Path) -> Path:
        """Write the stage of a mechanism with the motion of the correct robot; return the path of its root layer.

        `bound` is the mechanism with the trocar positions of the protocol.
        """
        folder.mkdir(parents=True, exist_ok=True)
        root = write_usd(mechanism, (), folder)[0]
        bake(mechanism, bound, protocol=self.trajectory.protocol, motion=self.motion, folder=folder)
        return root

    @cached_property
    def motion(self) -> LinkMotion:
        """Motion of the correct robot at the times of a baked motion."""
        bound = self.robot.bound(self.protocol)
        return bound.link_motion(self.trajectory, baked_times(self.trajectory))

    # -- the correct robot -------------------------------------------------------------------------------

    def case(self, **changes) -> Case:
        """Return the input of the validator for the correct robot; `changes` are fields of `Case` with new values."""
        case = Case(
            kinematics=self.kin,
            cad=self.cad,
            protocol=self.protocol,
            trajectory=self.trajectory,
            stage=self.stage,
            tolerances=self.tolerances,
            paths=self.paths,
            baked_for_it=True,
        )
        return replace(case, **changes)

    @cached_property
    def correct_report(self) -> Report:
        """Validation report of the correct robot, by all parts of the validator."""
        return judge(self.case(), known=KnownResults(measured=self.measured), parts=PARTS)

    @cached_property
    def measured(self) -> MeasuredMotion:
        """Measurements of the correct mechanism along the motion."""
        return measure_motion(self.robot.mechanism, sampled_motion(self.trajectory), self.case().written)

    @cached_property
    def equations_comparison(self) -> EquationsComparison:
        """Comparison of the equations with the correct mechanism."""
        clock = SampleClock(self.trajectory.t, phase_summaries(self.trajectory))
        model = ReferenceModel(self.robot.mechanism)
        return compare(
            self.kin,
            model,
            trajectory=self.trajectory,
            clock=clock,
            tolerances=self.tolerances,
            progress=silent,
        )

    @cached_property
    def link_poses(self) -> tuple[Array, dict[str, Array]]:
        """Key times (k,) in s, and {link: poses T_base_link (k, 4, 4)} of the correct robot at these times."""
        key_times = sampled_motion(self.trajectory).keys
        model = ReferenceModel(self.robot.mechanism)
        motion = self.trajectory.on(model, key_times)
        return key_times, model.link_poses(motion.x)

    @cached_property
    def usual_findings(self) -> set[tuple[str, str]]:
        """(code, place) of each finding on the correct robot, except findings of severity info."""
        places = set()
        for finding in self.correct_report.findings:
            if finding.severity != "info":
                places.add((finding.code, finding.where))
        return places

    # -- one fault ---------------------------------------------------------------------------------------

    def outcome(self, fault: SeededFault) -> Detection:
        """Seed a fault, run the validator, and return the result."""
        start = time.monotonic()
        reason = ""
        with tempfile.TemporaryDirectory(dir=self.folder) as name, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # NumPy and Python warn about many faults; only findings count
            try:
                finding, reason = self._judged(fault, Path(name))
            except TwinError as error:
                # an error of twin's own names the fault: it is as good as a finding
                kind = type(error).__name__.removesuffix("Error").lower()
                finding = error_finding(f"error.{kind}", "", str(error))
        code = ""
        where = ""
        state: State
        if finding is not None:
            code = finding.code
            where = finding.where
            message = finding.message
            state = "warned" if finding.severity == "warning" else "caught"
        elif reason:
            state = "equivalent"
            message = reason
        else:
            state = "missed"
            message = "no finding"
        seconds = round(time.monotonic() - start, 3)
        return Detection(
            fault.family,
            fault.kind,
            what=fault.what,
            state=state,
            code=code,
            where=where,
            message=message,
            seconds=seconds,
        )

    def _judged(self, fault: SeededFault, folder: Path) -> tuple[Finding | None, str]:
        """Return (new finding or None, reason why the fault has no effect or "").

        The parts of the validator run in order, until one part reports a finding more severe than a warning. This
        finding is returned. After a warning, only one more part runs; if this part reports nothing more severe, the
        warning is returned. If the first part finds nothing, the next part runs only if the fault has an effect.
        """
        warning = None
        reason = None
        faulty_stage = None
        if fault.stage is not None:
            faulty_stage = self._spoiled_stage(fault.stage, folder)
        for finding in self._part_findings(fault, folder, faulty_stage):
            if finding is not None and finding.severity != "warning":
                return finding, ""
            if warning is not None:
                break
            warning = finding
            if warning is None and reason is None:
                reason = self._equivalence(fault, folder, faulty_stage)
                if reason:
                    break
        return warning, reason or ""

    def _part_findings(self, fault: SeededFault, folder: Path, faulty_stage: Path | None) -> Iterator[Finding | None]:
        """For each part of the validator, fast parts first, yield the most severe new finding, or None without one.

        `faulty_stage` is the root layer of the stage with the fault; None if the fault is not one of a stage.
        """
        if fault.robot is not None:
            robot = fault.robot(folder)
            # the motion stays that of the correct equations: only the validator sees the faulty ones
            case = self.case(kinematics=robot.kinematics(parameters={}), paths=robot.path_kinematics())
            yield self._new_finding(judge(case, parts=_EQUATIONS))
            yield self._new_finding(judge(case, parts=PARTS, known=KnownResults(measured=self.measured)))
        elif fault.mechanism is not None:
            yield from self._of_mechanism(fault.mechanism(), folder)
        elif faulty_stage is not None:
            yield from self._of_stage(faulty_stage)
        elif fault.protocol is not None:
            yield from self._of_protocol(fault.protocol(folder), slow=fault.kind in ("speed", "turning"))
        elif fault.trajectory is not None:
            case = self.case(trajectory=fault.trajectory(), stage=self.still_stage)
            yield self._new_finding(judge(case, parts=_PROTOCOL))
            yield self._new_finding(judge(case, parts=_PROTOCOL | _EQUATIONS))
            yield self._new_finding(judge(case))

    def _of_mechanism(self, mechanism: Mechanism, folder: Path) -> Iterator[Finding | None]:
        """Yield the new findings on a mechanism with a fault, without its stage and then with it."""
        robot = self.robot.with_mechanism(mechanism)
        case = self.case(cad=robot.cad, paths=robot.path_kinematics())
        yield self._new_finding(judge(case, parts=_PROTOCOL | _EQUATIONS))
        # masses of the correct robot: the parts are the same, only their positions differ
        inertias = {}
        for body in self.weighed.bodies:
            inertias[body.name] = body.inertia
        bodies = []
        for body in mechanism.bodies:
            bodies.append(replace(body, inertia=inertias.get(body.name)))
        weighed = replace(mechanism, bodies=tuple(bodies))
        root = self.write_stage(weighed, mechanism, folder / "stage")
        # A case reads its stage once: each part gets its own case.
        yield self._new_finding(judge(replace(case, stage=root), parts=_PROTOCOL | _EQUATIONS | _STAGE))
        yield self._new_finding(judge(replace(case, stage=root)))

    def _spoiled_stage(self, spoil: Callable[[Path], None], folder: Path) -> Path:
        """Copy the stage into a folder, change the copy with `spoil`, and return the path of its root layer."""
        stage_folder = folder / "stage"
        shutil.copytree(self.stage.parent, stage_folder)
        spoil(stage_folder)
        return stage_folder / self.stage.name

    def _of_stage(self, faulty_stage: Path) -> Iterator[Finding | None]:
        """Yield the new findings on a stage with a fault, then on its motion."""
        case = self.case(stage=faulty_stage)
        # the stage changes no equation: their comparison is taken over, without what it found
        series = dict(self.equations_comparison.series)
        unchanged_comparison = replace(self.equations_comparison, residuals=[], findings=[], facts={}, series=series)
        yield self._new_finding(judge(case, parts=_STAGE, known=KnownResults(unchanged_comparison)))
        # only the written motion is measured anew: equations and mechanism are those of the correct robot
        measured = replace(self.measured, written=existing_motion(case.written, *self.link_poses))
        yield self._new_finding(judge(case, parts=_MOTION, known=KnownResults(unchanged_comparison, measured)))

    def _of_protocol(self, protocol: Protocol, slow: bool) -> Iterator[Finding | None]:
        """Yield the new findings on a protocol; `slow` is whether the fault may have made a speed too small."""
        yield self._most_severe(protocol.findings)
        if slow and protocol.findings:
            return  # a motion at such a low speed would take hours to check
        # the trocars of the mechanism are where the protocol states them, also where it states them wrongly
        robot = self.robot.bound(protocol)
        case = self.case(
            protocol=protocol,
            trajectory=self.planned(protocol, robot),
            cad=replace(self.cad, mechanism=robot.mechanism),
            paths=robot.path_kinematics(),
            kinematics=robot.kinematics(),
            stage=self.still_stage,
        )
        yield self._new_finding(judge(case, parts=_PROTOCOL | _EQUATIONS))
        yield self._new_finding(judge(case))

    def _new_finding(self, report: Report) -> Finding | None:
        """Return the most severe new finding of a report; None without one."""
        return self._most_severe(report.findings)

    def _most_severe(self, findings: Iterable[Finding]) -> Finding | None:
        """Return the first of the most severe findings that the correct robot does not have."""
        most_severe = None
        highest = -1
        for finding in findings:
            if finding.severity == "info" or (finding.code, finding.where) in self.usual_findings:
                continue
            severity = SEVERITIES.index(finding.severity)
            if severity > highest:
                highest = severity
                most_severe = finding
        return most_severe

    def _equivalence(self, fault: SeededFault, folder: Path, faulty_stage: Path | None) -> str:
        """Return the reason why a missed fault has no effect; "" if the fault has an effect.

        For `faulty_stage` see `_part_findings`.
        """
        # what cannot be computed with the fault has an effect
        with contextlib.suppress(TwinError):
            if fault.robot is not None:
                faulty_kin = fault.robot(_subfolder(folder)).kinematics(parameters={})
                # a fixed seed: the verdict on a fault does not depend on how many faults came before it
                return same_equations(self.kin, faulty_kin, self.trajectory, np.random.default_rng(1))
            if fault.mechanism is not None:
                return same_motion(self.robot.mechanism, fault.mechanism(), self.trajectory)
            if faulty_stage is not None:
                faulty_case = self.case(stage=faulty_stage)
                return same_stage(self.case().written or self.stage, faulty_case.written or faulty_case.stage)
            if fault.protocol is not None:
                return same_protocol(self.protocol, fault.protocol(_subfolder(folder)))
            if fault.trajectory is not None and fault.kind == "late joint":
                return same_samples(self.trajectory, fault.trajectory())
        return ""


def _subfolder(folder: Path) -> Path:
    """Make a folder for a second seeding of the same fault, beside the files of the first."""
    subfolder = folder / "again"
    subfolder.mkdir()
    return subfolder
