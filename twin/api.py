"""The public facade: load a robot, plan a protocol, validate, build its USD stage, export it."""

from __future__ import annotations

import contextlib
import copy
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin.core import assets
from twin.core.errors import ProtocolError, TwinError
from twin.core.foreign.admit import admit
from twin.core.spatial import Array

if TYPE_CHECKING:
    from twin.cad.build import CadModel
    from twin.exchange.write.bundle import Bundle
    from twin.exchange.write.clip import Budget
    from twin.kinematics import Formula, Kinematics, Solution, Task
    from twin.kinematics.closed_loops import LoopSolver
    from twin.kinematics.compiled import Beside
    from twin.model.mechanism import Mechanism
    from twin.planning.protocol import Protocol
    from twin.planning.trajectory import PathKinematics, Trajectory
    from twin.reference import ReferenceModel
    from twin.validation.result import Report
    from twin.validation.rows import Tolerances

Progress = Callable[[str, float], None]
"""Called with what is being done and the fraction done of it."""

STAGE_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")


def _silent(label: str, fraction: float) -> None:
    """Report to nobody."""


def names() -> list[str]:
    """Return the names of the built-in robots."""
    return assets.names()


class Robot:
    """A robot: its mechanism from the CAD (or a USD stage) and its equations.

    Made by `load`. Arrays are SI; poses are T_base_tool (4, 4); q holds the active joints in the order of
    `joints`. Heavy parts are loaded when first used.
    """

    def __init__(
        self,
        files: assets.RobotFiles | None,
        stage: Path | None = None,
        variants: Mapping[str, str] | str | None = None,
        parameters: Mapping[str, float] | None = None,
        tool: str | None = None,
    ) -> None:
        self.files = files
        self._stage, self._tool, self.told = stage, tool, ""  # told: what `mechanism` took for a tool that is not named
        self._variants, self._parameters = variants, parameters
        self._trocars: dict[str, Array] = {}
        self._is_weighed = False
        self.name = files.name if files is not None else stage.stem if stage is not None else ""

    def __repr__(self) -> str:
        return f"Robot({self.name!r})"

    @cached_property
    def cad(self) -> CadModel:
        """The mechanism as measured from the CAD, with what was found on the way; masses are not weighed.

        Raises:
            TwinError: the robot was loaded from a stage, or its description or CAD is wrong.
        """
        if self.files is None:
            raise TwinError(f"{self.name} was loaded from a USD stage: it has no CAD")
        from twin.cad.build import read_mechanism

        return read_mechanism(self.files.description, with_mass=False)

    @cached_property
    def mechanism(self) -> Mechanism:
        """Bodies, joints and loops, from the CAD or from the stage."""
        if self._stage is None:
            return self.cad.mechanism
        from twin.usd.read import read_stage, with_tool

        mechanism, self.told = with_tool(read_stage(self._stage), self._tool)
        return mechanism

    def kinematics(
        self, variants: Mapping[str, str] | str | None = None, parameters: Mapping[str, float] | None = None
    ) -> Kinematics:
        """Return the compiled equations, with the robot's variants and parameters (SI) unless others are asked for.

        Auxiliary joints, which the equations do not know, have their place in q: the inverse gives them as drawn.

        Raises:
            KinematicsError: no equations, or no such variant or parameter.
        """
        if variants is None and parameters is None:
            return self._kinematics
        from twin.kinematics import compile_formula

        chosen = self._variants if variants is None else variants
        formula, values = self.formula, {**(self._parameters or {}), **(parameters or {})}
        return compile_formula(formula, chosen, values, self._beside([j.name for j in formula.joints]))

    def _beside(self, names: Sequence[str]) -> Sequence[Beside]:
        """Return the driven joints that equations of `names` do not know.

        The mechanism is read only if there are some: who asks the equations alone does not wait for the CAD.
        """
        if self.files is not None:
            with contextlib.suppress(OSError, ValueError, AttributeError):  # the mechanism says what is wrong with it
                table = tomllib.loads(self.files.description.read_text(encoding="utf-8"))
                if all(j.get("name") in names for j in table.get("joint", ()) if j.get("active")):
                    return ()
        return self.mechanism.beside(names)

    @cached_property
    def _kinematics(self) -> Kinematics:
        return self.kinematics(parameters={})

    @cached_property
    def formula(self) -> Formula:
        """The equations, not compiled yet (`KinematicsError`: none, or wrong). To read a `formula.py` is to run it."""
        from twin.robots import load_formula

        return load_formula(assets.equations(self.files, self.name), self.name, lambda: self.mechanism.driven)

    @cached_property
    def loops(self) -> LoopSolver:
        """The mechanism's own forward kinematics, loops closed by compiled code: `forward(q)`, `forward_many(qs)`."""
        from twin.kinematics.closed_loops import LoopSolver

        return LoopSolver(self.mechanism)

    @property
    def unwritten(self) -> bool:
        """Whether the robot's formula.py is a template that waits for its equations."""
        return self.files is not None and self.files.formula.is_file() and not self.files.has_equations

    @property
    def joints(self) -> tuple[str, ...]:
        """Active joints, in the order of q."""
        return tuple(j.name for j in self.mechanism.active)

    @property
    def variants(self) -> dict[str, tuple[str, ...]]:
        """The variants of each equation that exist."""
        return dict(self._kinematics.choices)

    @property
    def frames(self) -> tuple[str, ...]:
        """The named frames."""
        return tuple(f.name for f in self.mechanism.frames)

    def inverse(
        self, T_base_tool: Array, variant: Mapping[str, str] | str | None = None, seed: Array | None = None
    ) -> Array:
        """Return q (n,) for a pose (4, 4), or (k, n) for poses (k, 4, 4).

        Without closed equations each pose begins at the answer before it, the first at the seed.

        Raises:
            KinematicsError: a pose is out of reach; of many it says which.
        """
        kin, T = self.kinematics(variant), np.asarray(T_base_tool, float)
        return kin.inverse(T, seed) if T.ndim == 2 else kin.inverse_of_all(T, seed)

    def forward(self, q: Array, variant: Mapping[str, str] | str | None = None, seed: Array | None = None) -> Array:
        """Return T_base_tool (4, 4) for q (n,), or (k, 4, 4) for (k, n), on the assembly branch of the seed pose.

        Raises:
            KinematicsError: no assembly, or not on that branch.
        """
        kin, q = self.kinematics(variant), np.asarray(q, float)
        return kin.forward(q, seed) if q.ndim == 1 else kin.forward_many(q, seed)

    def jacobian(self, q: Array, seed: Array | None = None) -> Array:
        """Return (6, n): the tool's twist in base, linear rows first, per rate of the active joints."""
        kin = self._kinematics
        return kin.jacobian(kin.forward(np.asarray(q, float), seed), q)

    def solve(self, task: Task, seed: Array | None = None) -> Solution:
        """Solve a task (a pose, a masked pose, tip and trocar, ...) by Levenberg-Marquardt within the joint limits.

        Raises:
            KinematicsError: no solution; the best iterate is attached.
        """
        from twin.kinematics import solve

        return solve(self._kinematics, task, seed, self.mechanism.limits)

    def reference(self) -> ReferenceModel:
        """Return the independent model: Pinocchio and loop closures, built from the mechanism alone."""
        from twin.reference import ReferenceModel

        return ReferenceModel(self.mechanism)

    def protocol(self, name: str | Path | None = None) -> Protocol:
        """Return a protocol by name or by path; without one, the robot's default.

        Raises:
            TwinError: no such protocol, or the file is wrong.
        """
        from twin.planning.protocol import load_protocol
        from twin.schema import error_at

        given = name is not None and Path(name).suffix == ".toml"
        if given:
            path = Path(str(name))
        elif self.files is None:
            raise TwinError(f"{self.name} was loaded from a USD stage: give the path of a protocol file")
        else:
            path = self.files.protocol(str(name or self.cad.description.default_protocol))
        protocol = load_protocol(path)
        if not given and protocol.name != path.stem:
            raise error_at(path, ("name",), f"'{protocol.name}' must be the file's name, '{path.stem}'")
        if protocol.robot != self.name:
            raise error_at(path, ("robot",), f"the protocol is written for '{protocol.robot}', not for '{self.name}'")
        return protocol

    def bound(self, protocol: Protocol) -> Robot:
        """Return the robot with its trocars where the protocol has them; itself if the protocol places none.

        Equations know the only one as parameters trocar_x, trocar_y, trocar_z, one of several as trocar_NAME_x, ...

        Raises:
            TwinError: the mechanism has no such trocar.
        """
        trocars = self.mechanism.trocars
        places = protocol.places_of(trocars)
        if not places:
            return self
        at = {
            f"trocar_{axis}" if len(trocars) == 1 else f"trocar_{name}_{axis}": float(v)
            for name, place in places.items()
            for axis, v in zip("xyz", place, strict=True)
        }
        out = Robot(self.files, self._stage, self._variants, {**(self._parameters or {}), **at}, self._tool)
        out._trocars, out._is_weighed = {**self._trocars, **places}, self._is_weighed
        mechanism = self.mechanism.with_trocars(places)
        if self.files is not None:
            out.cad = replace(self.cad, mechanism=mechanism)
        out.mechanism = mechanism
        return out

    def weighed(self) -> Robot:
        """Return the robot with the masses of its parts; where its trocars are bound, they stay.

        Raises:
            TwinError: the robot was loaded from a stage, or its description or CAD is wrong.
        """
        if self._is_weighed:
            return self
        if self.files is None:
            raise TwinError(f"{self.name} is a stage already")
        from twin.cad.build import read_mechanism

        cad = read_mechanism(self.files.description, with_mass=True)
        if self._trocars:
            cad = replace(cad, mechanism=cad.mechanism.with_trocars(self._trocars))
        out = copy.copy(self)
        vars(out).pop("loops", None)  # they hold the mechanism
        out.cad, out.mechanism, out._is_weighed = cad, cad.mechanism, True
        return out

    def path_kinematics(self) -> PathKinematics:
        """Return what planning needs: limits, equations, and the mechanism, which leads alone while there are none."""
        from twin.planning.trajectory import without_equations
        from twin.reference.leading import Leader

        leader = Leader(self.reference)
        mechanical = without_equations(self.mechanism, leader, self.cad.gaps if self.files else ())
        if self.unwritten:
            return mechanical
        kin, order = self._kinematics, mechanical.joint_names
        if order != kin.joints:
            raise TwinError(
                f"{self.name}: the description drives {', '.join(order)}, the equations {', '.join(kin.joints)}; "
                "make the names and their order equal"
            )
        return replace(
            mechanical,
            inverse=kin.inverse_many,
            reach=lambda Ts: kin.reach(Ts=Ts),
            singularity=lambda Ts, q: kin.singularity(Ts=Ts, qs=q),
            singularity_alarm={m.name: m.alarm for m in kin.formula.measures},
            branch=lambda Ts, q: kin.branch(Ts=Ts, qs=q),
            why=kin.why,
            auxiliary={name: value for _, name, _, value in kin.beside},
            takes=lambda Ts: kin.takes(Ts) or leader.model.freedoms == 6,
        )


def load(
    robot: str | Path,
    *,
    variants: Mapping[str, str] | str | None = None,
    parameters: Mapping[str, float] | None = None,
    tool: str | None = None,
) -> Robot:
    """Return a robot.

    Args:
        robot: the name of a built-in robot, the path of a robot folder, or of a USD stage (mechanism only).
        variants: variant by equation, or one name for all; default: each equation's own.
        parameters: values in SI that replace published ones in the equations.
        tool: frame or body of a stage that is its tool; default what the stage says, else the end of its longest chain.

    Raises:
        TwinError: there is no such robot, or it is no stage and says itself what its tool is.
    """
    path = Path(robot)
    if path.suffix in STAGE_SUFFIXES:
        if not path.is_file():
            raise TwinError(f"{path}: there is no such stage")
        admit(path)
        return Robot(None, path, variants, parameters, tool)
    if tool is not None:
        raise TwinError(f"{robot} is no USD stage: its description says what its tool is")
    return Robot(assets.files(robot), None, variants, parameters)


def plan(robot: Robot, protocol: str | Path | Protocol | None = None, progress: Progress = _silent) -> Trajectory:
    """Return the timed trajectory of a protocol, checked at 1 kHz.

    Raises:
        ProtocolError: it cannot be carried out; phase, place and size are named.
        TimingError: no timing within the limits.
    """
    from twin.planning.plan import plan as plan_
    from twin.planning.protocol import Protocol

    chosen = protocol if isinstance(protocol, Protocol) else robot.protocol(protocol)
    robot = robot.bound(chosen)
    T = robot.mechanism.frame_in_tool(chosen.frame)
    return plan_(chosen, robot.path_kinematics(), T_tool_frame=T, progress=lambda phase: progress(f"plan {phase}", 0.0))


def validate(
    robot: Robot,
    trajectory: Trajectory | None = None,
    *,
    protocol: str | Path | None = None,
    variants: Mapping[str, str] | str | None = None,
    tolerances: Tolerances | None = None,
    stage: Path | None = None,
    baked: bool = False,
    progress: Progress = _silent,
) -> Report:
    """Judge the equations against the mechanism along a protocol, and the mechanism against its USD stage.

    Args:
        robot: with CAD and equations.
        trajectory: as planned, or None to plan now.
        protocol: its protocol; default the robot's default protocol.
        variants: the variants to judge; the motion is always planned with the robot's own.
        tolerances: what counts as agreement; default: that of exact geometry, widened by what placements lost.
        stage: root layer to judge; default the robot's own, or a fresh one if that is missing or stale.
        baked: the motion beside that stage was just made for this trajectory; else it may be older, which only warns.
        progress: see `Progress`.

    Raises:
        TwinError: something is missing or wrong, so that nothing could be judged.
    """
    from twin.exchange.write.usd import fresh_stage
    from twin.validation.case import Case
    from twin.validation.commands import commands
    from twin.validation.judge import judge
    from twin.validation.lengths import check_parameters
    from twin.validation.rows import Tolerances

    progress("read CAD", 0.0)
    used = tolerances or Tolerances().widened(10 * robot.cad.placement_loss)
    chosen = robot.protocol(protocol or (trajectory.protocol if trajectory is not None else None))
    said = None if robot._parameters else protocol or chosen.name  # no command line gives other parameters
    robot = robot.bound(chosen)
    kin = robot.kinematics(variants) if variants is not None or not robot.unwritten else None
    if kin is not None:
        check_parameters(kin, robot.cad.description)
    if trajectory is None:
        trajectory = plan(robot, chosen, progress)
    assert robot.files is not None  # it has CAD
    with contextlib.nullcontext(stage) if stage is not None else fresh_stage(robot.files) as root:
        sides = (kin, robot.cad, chosen, trajectory, root, used)
        report = judge(Case(*sides, robot.path_kinematics(), baked), progress)
    return report if said is None else replace(report, commands=commands(robot.files, kin, said, tolerances))


def build(
    robot: Robot,
    folder: Path | None = None,
    *,
    protocols: tuple[str, ...] | None = None,
    progress: Progress = _silent,
) -> list[Path]:
    """Write the robot's USD stage: meshes, masses, joints, and one baked motion for each protocol.

    Args:
        robot: with CAD; without equations yet, motions that the mechanism cannot be led along are left out.
        folder: where to; default: usd/<robot>/ in a checkout, the folder's usd/ for a robot of one's own.
        protocols: which to bake; default all.
        progress: see `Progress`.

    Returns:
        The files written, root layer first.

    Raises:
        OutputError: the folder cannot be written; nothing half-written is left.
    """
    from twin.exchange.write.usd import bake, write_usd

    if robot.files is None:
        raise TwinError(f"{robot.name} is a stage already")
    if folder is None:
        if not assets.is_checkout() and robot.name in names():
            raise TwinError("the installed data is read-only: say where to write with --out")
        folder = robot.files.usd
    progress("read CAD, weigh parts", 0.0)
    robot = robot.weighed()
    assert robot.files is not None
    chosen = protocols or ()
    if protocols is None and (robot.files.has_equations or robot.unwritten):
        chosen = tuple(robot.files.protocols())
    with assets.atomic_folder(folder) as work:
        root = write_usd(robot.mechanism, (), work)[0]
        for i, name in enumerate(chosen):
            progress(f"bake {name}", i / len(chosen))
            try:
                bound, trajectory = robot.bound(robot.protocol(name)).mechanism, plan(robot, name)
            except ProtocolError:
                if protocols is None and robot.unwritten:  # `twin plan` says why
                    continue
                raise
            bake(robot.mechanism, bound, trajectory, work)
        written = sorted(p.relative_to(work) for p in work.rglob("*") if p.is_file())
        first = root.relative_to(work)
    return [folder / first, *(folder / p for p in written if p != first)]


def export(
    robot: Robot,
    trajectory: Trajectory | None = None,
    folder: Path | None = None,
    formats: Sequence[str] | None = None,
    *,
    protocols: Sequence[str | Path] | None = None,
    budget: Budget | None = None,
    progress: Progress = _silent,
) -> Bundle:
    """Write the robot with its motions for headsets, engines and simulators, and let the audit read it again.

    Args:
        robot: of CAD, or of a USD stage with the motion baked in it, if there is one.
        trajectory: the only motion, as planned; None: the protocols.
        folder: where to; default ./twin-out/<robot>/export/.
        formats: of "usd", "usdz", "glb", "unity", "tracks", "mjcf", "urdf"; default all.
        protocols: names or paths; default every protocol of the robot.
        budget: what may go wrong between keys; decides the key rate.
        progress: see `Progress`.

    Raises:
        TwinError: something is missing or wrong; the folder is then left as it was.
    """
    from twin.exchange.audit import audit
    from twin.exchange.write.bundle import chosen_formats, write_bundle
    from twin.exchange.write.order import order

    kinds = chosen_formats(formats)
    assets.require_writable(folder := Path(folder or Path("twin-out") / robot.name / "export"))
    return write_bundle(order(robot, trajectory, protocols, budget, plan, progress), folder, kinds, audit, progress)
