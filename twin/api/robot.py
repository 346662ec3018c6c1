"""A robot, loaded by name, folder, USD stage or description file: its mechanism, equations and protocols."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from twin.core import assets, compute_device
from twin.core.errors import AssemblyError, TwinError, unknown
from twin.core.foreign.admit import admit
from twin.core.foreign.budget import STAGE_SUFFIXES, read_bytes
from twin.core.spatial import Array

if TYPE_CHECKING:
    from twin.cad.build import CadModel
    from twin.cad.description import Description
    from twin.core.compute_device import Choice
    from twin.kinematics import Formula, Kinematics, Solution, Task
    from twin.kinematics.closed_loops import LoopSolver
    from twin.kinematics.closed_loops.passive_limits import PassiveCheck
    from twin.kinematics.compiled import ExtraJoint
    from twin.model.mechanism import Mechanism
    from twin.planning.link_motion import LinkMotion
    from twin.planning.protocol import Protocol, Solver
    from twin.planning.trajectory import Keep, PathKinematics, Trajectory
    from twin.reference import ReferenceModel
    from twin.reference.dynamics import Dynamics

_TRIED_LENGTH = 0.02
"""Step of a prismatic joint in m to states at which forward equations are tried; see `Robot.path_kinematics`."""

_TRIED_ANGLE = 0.3
"""The same step of a revolute joint, in rad."""

_TRIED_ERROR = 1e-6
"""Largest difference of tool poses, in m or as an entry of a rotation, with which these equations count as right."""

Progress = Callable[[str, float], None]
"""Function that is called to report progress, with the name of the current step and the fraction done (0 to 1)."""


def silent(label: str, fraction: float) -> None:
    """Report nothing: the default of `progress`."""


def names() -> list[str]:
    """Return the names of the built-in robots.

    Examples:
        >>> import twin
        >>> "sils" in twin.names()
        True
    """
    return assets.names()


class DescribedRobot(typing.Protocol):
    """A description file in a foreign format; see `twin.api.imported_file`."""

    @property
    def path(self) -> Path:
        """The file."""
        ...

    @property
    def name(self) -> str:
        """Name of the file without suffixes."""
        ...

    @property
    def options(self) -> tuple[str, ...]:
        """Names of the options of `load` that were given for this file."""
        ...

    @property
    def opened(self) -> tuple[Mechanism, str]:
        """Mechanism with its tool, and a note on the assumed tool."""
        ...

    @property
    def unlimited(self) -> frozenset[str]:
        """Joints of which the file states that they have no limits."""
        ...

    @property
    def efforts(self) -> Mapping[str, float]:
        """Largest effort in N or N m of each joint for which the file states an effort, but no gains."""
        ...


class RobotSource:
    """The CAD, USD stage or description file of a robot, read once and shared by all robots with this source."""

    def __init__(
        self,
        files: assets.RobotFiles | None,
        stage: Path | None,
        tool: str | None = None,
        described: DescribedRobot | None = None,
    ) -> None:
        self.files = files
        self.stage = stage
        self.tool = tool
        self.described = described

    @property
    def path(self) -> Path | None:
        """The stage or the description file; None for a robot with a folder."""
        if self.described is not None:
            return self.described.path
        return self.stage

    @property
    def kind(self) -> str:
        """What the robot was loaded from, for messages: "a USD stage", or "the file arm.urdf"."""
        if self.described is not None:
            return f"the file {self.described.path.name}"
        return "a USD stage"

    @property
    def options(self) -> tuple[str, ...]:
        """Names of the options of `load` that were given for the stage or file, and that change its mechanism."""
        if self.described is not None:
            return self.described.options
        if self.tool is not None:
            return ("tool",)
        return ()

    @cached_property
    def cad(self) -> CadModel:
        """The robot measured on the CAD, without masses."""
        return self._read(with_mass=False)

    @cached_property
    def weighed(self) -> CadModel:
        """The robot measured on the CAD, with the masses of the parts."""
        return self._read(with_mass=True)

    @cached_property
    def description(self) -> Description:
        """The content of the robot's TOML file."""
        from twin.cad.description import load

        return load(self._files.description, self._files.read)

    @property
    def _files(self) -> assets.RobotFiles:
        if self.files is None:
            name = self.path.stem if self.path else "the robot"
            raise TwinError(f"{name} was loaded from {self.kind}: it has no CAD")
        return self.files

    @cached_property
    def opened(self) -> tuple[Mechanism, str]:
        """Mechanism of the stage or file, and a note on the assumed tool (the note is "" if the tool is named)."""
        from twin.usd.read import read_stage, with_tool

        if self.described is not None:
            return self.described.opened

        assert self.stage is not None
        mechanism = read_stage(self.stage)
        return with_tool(mechanism, self.tool)

    def _read(self, with_mass: bool) -> CadModel:
        from twin.cad.build import read_mechanism

        return read_mechanism(self._files.description, with_mass=with_mass, read=self._files.read)

    @contextlib.contextmanager
    def fresh_stage(self) -> Iterator[Path]:
        """Yield the robot's own USD stage if it is up to date with the CAD, else one rebuilt in a temporary folder."""
        from twin.exchange.formats.usd.write import fresh_stage

        cad = vars(self).get("weighed") or self.cad  # `cad` and `weighed` have the same file hash
        with fresh_stage(self._files.stage, cad.mechanism.source, lambda: self.weighed.mechanism) as root:
            yield root


@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    """A robot: its mechanism from the CAD (or a stage or file) and its equations. Made by `load`; immutable.

    Arrays are in SI units; poses are T_base_tool (4, 4); q (n,) has the values of the active joints, in the order of
    `joints`. CAD and equations are loaded when first used. `bound`, `weighed` and `with_...` return new robots with the
    same source. Without equations, `forward`, `inverse` and `jacobian` are those of the mechanism.

    Attributes:
        source: the CAD, stage or description file from which the robot is read.
        files: files of the robot; None if it was loaded from a stage or a description file.
        chosen_variants: {equation: variant}, one name for all equations, or None (the default of each equation).
        parameters: values (SI) by name that replace published values in the equations.
        trocars: {trocar: position (3,) in m in the base frame} that replace the positions of the description.
        is_weighed: whether the masses of the bodies are computed.
        changed: mechanism that replaces the mechanism of the source (a design, a seeded fault), or None.
        equations: formula that replaces the formula of the source, or None.
        timing: solver of the timing of all protocols, "passes" or "toppra"; None: each protocol names its solver.
        inverse_by: what gives the joint values of planned poses: "equations", or "points", the published optimisation.
    """

    source: RobotSource
    files: assets.RobotFiles | None
    chosen_variants: Mapping[str, str] | str | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    trocars: Mapping[str, Array] = field(default_factory=dict)
    is_weighed: bool = False
    changed: Mechanism | None = None
    equations: Formula | None = None
    timing: Solver | None = None
    inverse_by: Literal["equations", "points"] = "equations"

    @property
    def name(self) -> str:
        """Name of the robot's folder, or of the file of the stage or description."""
        if self.files is not None:
            return self.files.name
        if self.source.described is not None:
            return self.source.described.name
        if self.source.stage is not None:
            return self.source.stage.stem
        return ""

    def __repr__(self) -> str:
        return f"Robot({self.name!r})"

    def _repr_html_(self) -> str:
        """Return the robot as a notebook shows it."""
        variants: list[str] = ["no equations: the mechanism answers"]
        if self.has_equations:
            variants = []
            for equation, choices in self.variants.items():
                for choice in choices:
                    variants.append(f"{equation}={choice}")
        protocols: tuple[str, ...] = ()
        if self.files is not None:
            protocols = tuple(self.files.protocols())
        # by name: only notebooks need it
        page = import_module("twin.api.robot_html")
        return page.html_of(self.name, self.mechanism, variants, protocols)

    @cached_property
    def cad(self) -> CadModel:
        """The mechanism measured on the CAD, with findings.

        Raises:
            TwinError: the robot was loaded from a stage or file, or its description or CAD is malformed.
        """
        if self.files is None:
            raise TwinError(f"{self.name} was loaded from {self.source.kind}: it has no CAD")
        if self.is_weighed:
            cad = self.source.weighed
        else:
            cad = self.source.cad
        mechanism = self._placed(self.changed or cad.mechanism)
        return replace(cad, mechanism=mechanism)

    @cached_property
    def mechanism(self) -> Mechanism:
        """Bodies, joints and loops, from the CAD, the stage or the description file."""
        if self.source.path is None:
            return self.cad.mechanism
        if self.changed is not None:
            return self._placed(self.changed)
        mechanism, _ = self.source.opened
        return self._placed(mechanism)

    @property
    def gaps(self) -> tuple[tuple[str, str, float], ...]:
        """(lower joint, upper joint, minimum difference upper - lower in m) of joints on one rail; () for a stage."""
        if self.files is None:
            return ()
        return self.cad.gaps

    @property
    def tool_note(self) -> str:
        """Note on the assumed tool if the robot's stage or description file names no tool; else ""."""
        if self.source.path is None:
            return ""
        _, note = self.source.opened
        return note

    def _placed(self, mechanism: Mechanism) -> Mechanism:
        if not self.trocars:
            return mechanism
        return mechanism.with_trocars(self.trocars)

    def kinematics(
        self, variants: Mapping[str, str] | str | None = None, parameters: Mapping[str, float] | None = None
    ) -> Kinematics:
        """Return the compiled equations, with the given variants and parameters (SI); default: the robot's own.

        Auxiliary joints are not in the equations but are part of q: for them, the inverse returns the CAD's values.

        Raises:
            KinematicsError: there are no equations, or a variant or parameter does not exist.
        """
        if variants is None and parameters is None:
            return self._kinematics  # compiled once for each robot
        from twin.kinematics import compile_formula

        if variants is None:
            variants = self.chosen_variants
        formula = self.formula
        values = {**self.parameters, **(parameters or {})}
        names_in_equations = [joint.name for joint in formula.joints]
        extra_joints = self._extra_joints(names_in_equations)
        return compile_formula(formula, variants, values, extra_joints)

    def _extra_joints(self, names: Sequence[str]) -> Sequence[ExtraJoint]:
        """Return the driven joints that are not in the equations; `names` are the joints of the equations.

        The CAD is read only if the description has such joints, so that robots without them load fast.
        """
        if self.files is not None:
            with contextlib.suppress(TwinError):  # these errors are raised again when the mechanism is read
                active_names = set()
                for joint in self.source.description.joint:
                    if joint.active:
                        active_names.add(joint.name)
                if active_names <= set(names):
                    return ()
        return self.mechanism.extra_joints(names)

    @cached_property
    def _kinematics(self) -> Kinematics:
        return self.kinematics(parameters={})

    @cached_property
    def formula(self) -> Formula:
        """The equations before compilation. A robot folder's `formula.py` is executed.

        Raises:
            KinematicsError: the equations are missing or malformed.
        """
        from twin.robots import load_formula

        if self.equations is not None:
            return self.equations
        path = assets.equations(self.files, self.name)
        read = read_bytes if self.files is None else self.files.read
        return load_formula(path, self.name, lambda: self.mechanism.driven, read=read)

    @cached_property
    def loops(self) -> LoopSolver:
        """Compiled solver of the mechanism's loop closure, which does not use formula.py."""
        from twin.kinematics.closed_loops import LoopSolver

        return LoopSolver(self.mechanism)

    @cached_property
    def passive_check(self) -> PassiveCheck:
        """Check of the limits of passive joints at many tool poses, by the compiled loops."""
        from twin.kinematics.closed_loops.passive_limits import PassiveCheck

        return PassiveCheck(self.loops)

    def link_motion(self, trajectory: Trajectory, times: Array) -> LinkMotion:
        """Return joint values and poses of all bodies at times (k,) in s, by equations and compiled loops.

        The robot must have the trocar positions of the protocol of the trajectory, see `bound`. This motion drives
        stages and clips; see `planning.link_motion`.

        Raises:
            AssemblyError: the loops of the mechanism cannot be closed.
        """
        from twin.planning.link_motion import link_motion

        inverse = None
        if not self.unwritten:
            inverse = self._kinematics.inverse_many
        return link_motion(self.loops, trajectory, times, inverse)

    @cached_property
    def has_equations(self) -> bool:
        """Whether the robot has equations; without them, its mechanism answers `forward`, `inverse` and `jacobian`."""
        if self.equations is not None:
            return True
        return self.files is not None and self.files.has_equations

    @cached_property
    def _by_mechanism(self) -> Any:
        """A `twin.api.mechanism_kinematics.MechanismKinematics`; by name, as robots with equations do not need it."""
        module = import_module("twin.api.mechanism_kinematics")
        return module.MechanismKinematics(self.loops, self.reference())

    @property
    def unwritten(self) -> bool:
        """Whether the robot's formula.py is still the empty template."""
        return self.files is not None and self.files.formula.is_file() and not self.files.has_equations

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the active joints, in the order of q."""
        return tuple(joint.name for joint in self.mechanism.active)

    @property
    def variants(self) -> dict[str, tuple[str, ...]]:
        """{equation: names of its variants}."""
        return dict(self._kinematics.choices)

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the robot's frames."""
        return tuple(frame.name for frame in self.mechanism.frames)

    def inverse(
        self,
        T_base_tool: Array,
        variant: Mapping[str, str] | str | None = None,
        seed: Array | None = None,
        *,
        device: Choice | None = None,
    ) -> Array:
        """Return q (n,) for a pose (4, 4), or (k, n) for poses (k, 4, 4).

        Without an inverse equation, each solution is searched from the solution for the pose before; the first search
        starts at `seed` (n,). Without any equations, the mechanism is solved, from the rest poses or from `seed`.
        `device` is what computes many poses, see `twin.computing_on`; None: what the surrounding block chooses.

        Raises:
            KinematicsError: a pose is out of reach; for several poses, the message names the index of the first one.
            TwinError: there is no such device.

        Examples:
            >>> import twin
            >>> robot = twin.load("sils")
            >>> q = robot.mechanism.posture("insertion")
            >>> T = robot.forward(q)
            >>> bool(abs(robot.inverse(T) - q).max() < 1e-9)
            True
        """
        T = np.asarray(T_base_tool, float)
        with _on(device):
            if variant is None and not self.has_equations:
                if T.ndim == 2:
                    return self._by_mechanism.inverse(T, seed)
                return self._by_mechanism.inverse_of_all(T, seed)
            kin = self.kinematics(variant)
            if T.ndim == 2:
                return kin.inverse(T, seed)
            return kin.inverse_of_all(T, seed)

    def forward(
        self,
        q: Array,
        variant: Mapping[str, str] | str | None = None,
        seed: Array | None = None,
        *,
        device: Choice | None = None,
    ) -> Array:
        """Return T_base_tool (4, 4) for q (n,), or (k, 4, 4) for q (k, n), on the branch of the seed pose (4, 4).

        For rows of q (k, n) without a solution, the poses are NaN. Without equations, the mechanism is solved, from
        the rest poses or from its assembly at the seed pose. `device` is what computes many rows, see
        `twin.computing_on`; None: what the surrounding block chooses.

        Raises:
            KinematicsError: for q (n,), there is no assembly, or no assembly on that branch.
            TwinError: there is no such device.

        Examples:
            >>> import twin
            >>> robot = twin.load("pa10")
            >>> robot.forward([0.1, 0.4, 0.0, 1.2, 0.0, 0.5, 0.0]).shape
            (4, 4)
        """
        q = np.asarray(q, float)
        with _on(device):
            if variant is None and not self.has_equations:
                if q.ndim == 1:
                    return self._by_mechanism.forward(q, seed)
                return self._by_mechanism.forward_many(q, seed)
            kin = self.kinematics(variant)
            if q.ndim == 1:
                return kin.forward(q, seed)
            return kin.forward_many(q, seed)

    def jacobian(self, q: Array, seed: Array | None = None) -> Array:
        """Return the Jacobian (6, n) from rates of the active joints to the tool twist in base, linear rows first.

        `seed` (4, 4) is a pose that selects the branch of the forward kinematics. Without equations, the mechanism is
        solved.

        Raises:
            KinematicsError: there is no assembly at q (n,), or no assembly on that branch.

        Examples:
            >>> import twin
            >>> robot = twin.load("sils")
            >>> robot.jacobian(robot.mechanism.posture("insertion")).shape
            (6, 6)
        """
        if not self.has_equations:
            return self._by_mechanism.jacobian(np.asarray(q, float), seed)
        kin = self._kinematics
        T = kin.forward(np.asarray(q, float), seed)
        return kin.jacobian(T, q)

    def solve(
        self, task: Task, seed: Array | None = None, *, method: Literal["joints", "points"] = "joints"
    ) -> Solution:
        """Solve a task (full or partial pose, tip and trocar, ...) by Levenberg-Marquardt within the joint limits.

        Args:
            task: the task.
            seed: q (n,) or pose (4, 4) to start from; for "points", q (n,).
            method: unknowns of the iteration. "joints": for every robot and task. "points": points of the arm, as
                published for some robots (PA-10: elbow and wrist), for `Tip(p) + Trocar(c, axis)` only.

        Raises:
            KinematicsError: there is no solution (its attribute `best` is the best iterate), or the robot has no
                optimisation of points.
        """
        from twin.kinematics import solve
        from twin.kinematics.point_search import point_solver

        if method not in ("joints", "points"):
            raise TwinError(unknown("method", method, ("joints", "points")))
        if method == "points":
            return point_solver(self._kinematics).solve(task, seed, self.mechanism.limits)
        return solve(self._kinematics, task, seed, self.mechanism.limits)

    def hashes(self) -> dict[str, str]:
        """Return {file of equations or mechanism: SHA-256 of its bytes}; empty for a robot without files."""
        if self.files is None:
            return {}
        hashes = {}
        for path in (self.files.formula, self.files.description, *sorted(self.files.cad.glob("*.step"))):
            if path.is_file():
                hashes[path.name] = hashlib.sha256(path.read_bytes()).hexdigest()
        return hashes

    def reference(self) -> ReferenceModel:
        """Return the independent reference model: Pinocchio and loop closures, built from the mechanism alone."""
        from twin.reference import ReferenceModel

        return ReferenceModel(self.mechanism)

    def dynamics(self) -> Dynamics:
        """Return the equations of motion, with the masses of the parts and the motor rotors, without friction.

        Raises:
            TwinError: the description or CAD is malformed.
        """
        from twin.reference.dynamics import Dynamics

        if self.files is None:  # a stage or file states its masses
            return Dynamics(self.mechanism)
        return Dynamics(self.weighed().mechanism)

    def protocol(self, name: str | Path | None = None) -> Protocol:
        """Return the protocol with a name or path; default: the robot's default protocol.

        Raises:
            TwinError: the protocol does not exist, or its file is malformed.
        """
        from twin.planning.protocol import load_protocol
        from twin.schema import error_at

        is_path = name is not None and Path(name).suffix == ".toml"
        if is_path:
            path = Path(str(name))
        elif self.files is None:
            raise TwinError(f"{self.name} was loaded from {self.source.kind}: give the path of a protocol file")
        else:
            path = self.files.protocol(str(name or self.source.description.default_protocol))
        if self.files is None:
            protocol = load_protocol(path)
        else:
            protocol = load_protocol(path, self.files.read)
        # results and baked motions have the name in the file, commands that of the file
        if not is_path and protocol.name != path.stem:
            raise error_at(path, ("name",), f"'{protocol.name}' must be the file's name, '{path.stem}'")
        if protocol.robot != self.name:
            raise error_at(path, ("robot",), f"the protocol is written for '{protocol.robot}', not for '{self.name}'")
        if self.timing is None:
            return protocol
        return replace(protocol, timing=self.timing)

    def bound(self, protocol: Protocol) -> Robot:
        """Return the robot with its trocars at the positions that the protocol states; without any, the same robot.

        The equations have parameters trocar_x, trocar_y, trocar_z for a single trocar; with several trocars, they have
        parameters trocar_NAME_x, ... for each trocar.

        Raises:
            TwinError: the mechanism has no such trocar.
        """
        trocars = self.mechanism.trocars
        places = protocol.places_of(trocars)
        if not places:
            return self
        coordinates: dict[str, float] = {}
        for name, place in places.items():
            prefix = "trocar" if len(trocars) == 1 else f"trocar_{name}"
            for axis, value in zip("xyz", place, strict=True):
                coordinates[f"{prefix}_{axis}"] = float(value)
        return replace(self, parameters={**self.parameters, **coordinates}, trocars={**self.trocars, **places})

    def with_parameters(self, values: Mapping[str, float]) -> Robot:
        """Return the robot with these parameter values (SI) in its equations."""
        return replace(self, parameters={**self.parameters, **values})

    def with_mechanism(self, mechanism: Mechanism) -> Robot:
        """Return the robot with another mechanism, including its masses, instead of the mechanism of its source."""
        return replace(self, changed=mechanism)

    def with_transmission(self, variant: str) -> Robot:
        """Return the robot with the matrix between motors and joints that its description calls `variant`.

        Raises:
            MechanismError: the description has no such matrix, or the matrix cannot be inverted.
        """
        from twin.cad.actuators import transmissions

        chosen = transmissions(self.cad.description, variant)
        return self.with_mechanism(replace(self.mechanism, transmissions=chosen))

    def with_timing(self, solver: Solver | None) -> Robot:
        """Return the robot whose protocols are timed by "passes" or "toppra"; None: by the solver that each names.

        Raises:
            TwinError: there is no such solver.
        """
        from twin.planning.protocol import SOLVERS

        if solver is not None and solver not in SOLVERS:
            raise TwinError(unknown("solver of the timing", solver, SOLVERS))
        return replace(self, timing=solver)

    def with_inverse(self, by: Literal["equations", "points"]) -> Robot:
        """Return the robot whose plans compute joint values by the equations, or by the published search for points.

        Raises:
            TwinError: there is no such inverse, or the formula has no search for points.
        """
        if by not in ("equations", "points"):
            raise TwinError(unknown("inverse", by, ("equations", "points")))
        if by == "points" and self.formula.point_search is None:
            raise TwinError(f"{self.name}: the formula has no search for points (point_search); plan by the equations")
        return replace(self, inverse_by=by)

    def with_formula(self, formula: Formula) -> Robot:
        """Return the robot with the given equations instead of the equations of its files."""
        return replace(self, equations=formula)

    def weighed(self) -> Robot:
        """Return the robot with the masses of its parts; trocar positions are kept.

        Raises:
            TwinError: the robot was loaded from a stage or file, or its description or CAD is malformed.
        """
        if self.files is None:
            raise TwinError(f"{self.name} was loaded from {self.source.kind}: there is no CAD to compute masses from")
        if self.is_weighed:
            return self
        weighed = replace(self, is_weighed=True)
        for name in ("formula", "_kinematics"):  # masses do not affect the equations: keep the compiled functions
            if name in vars(self):
                vars(weighed)[name] = vars(self)[name]
        return weighed

    def _forward_holds(self, kin: Kinematics) -> bool:
        """Return whether the forward equations give the mechanism's tool poses at home and with each joint moved."""
        model = self.reference()
        home = model.home().q
        low, high = model.mechanism.limits.T
        is_angle = [joint.is_angle for joint in model.mechanism.active]
        sizes = np.where(is_angle, _TRIED_ANGLE, _TRIED_LENGTH)
        steps = np.diag(sizes)  # one joint in each row
        # away from an upper limit that the step would exceed
        displaced = np.where(home + steps <= high, home + steps, home - steps)
        states = np.vstack([home, np.clip(displaced, low, high)])
        try:
            run = model.run(states)
        except AssemblyError:  # the plan will name the loop that opens
            return True
        Ts = kin.forward_many(run.q)
        if not np.isfinite(Ts).any():
            return False
        errors = np.abs(Ts - run.Ts_base_tool)
        largest_error = np.nanmax(errors, initial=0.0)
        return bool(largest_error <= _TRIED_ERROR)

    def path_kinematics(self) -> PathKinematics:
        """Return the limits, the equations (if the robot has any) and the mechanism, for planning."""
        from twin.planning.trajectory import without_equations
        from twin.reference.follower import Follower
        from twin.reference.joint_space import JointSpace

        follower = Follower(self.reference)

        @cache  # shapes of bodies take seconds to read, and each phase of a protocol asks for them
        def space_around_obstacles(scene: str, clearance: float) -> JointSpace:
            around = None
            if scene:
                # by name: only a path around other robots reads a scene
                obstacles_in_base = import_module("twin.api.scene_obstacles").obstacles_in_base
                around = partial(obstacles_in_base, scene, self.name, load)
            return JointSpace(lambda: follower.model, clearance, around=around)

        def space(scene: str, clearance: float, keep: Keep) -> JointSpace:
            return space_around_obstacles(scene, clearance).keeping(keep)

        def passive_margins(Ts: Array, q: Array) -> dict[str, tuple[Array, bool]]:
            try:
                check = self.passive_check
            except AssemblyError:  # the loops do not close as drawn, which is reported elsewhere
                return {}
            if not check.limits:
                return {}
            return check.margins(q, Ts)

        by_mechanism = without_equations(self.mechanism, follower, self.gaps, space)
        by_mechanism = replace(by_mechanism, passive=passive_margins)
        if self.unwritten:
            return by_mechanism
        kin = self._kinematics
        order = by_mechanism.joint_names
        if order != kin.joints:
            raise TwinError(
                f"{self.name}: the driven joints are {', '.join(order)} in the description, but "
                f"{', '.join(kin.joints)} in the equations; use the same names in the same order"
            )
        if not kin.closed_inverse and not self._forward_holds(kin):
            return by_mechanism  # an inverse by iteration of wrong equations would try every pose in vain
        inverse = kin.inverse_many
        if self.inverse_by == "points":
            from twin.kinematics.point_search import point_solver

            inverse = point_solver(kin).inverse_many
        auxiliary = {}
        for _, name, _, value in kin.extra_joints:
            auxiliary[name] = value
        alarms = {}
        for measure in kin.formula.measures:
            alarms[measure.name] = measure.alarm
        return replace(
            by_mechanism,
            inverse=inverse,
            reach=lambda Ts: kin.reach(Ts=Ts),
            singularity=lambda Ts, q: kin.singularity(Ts=Ts, qs=q),
            singularity_alarm=alarms,
            branch=lambda Ts, q: kin.branch(Ts=Ts, qs=q),
            why=kin.why,
            auxiliary=auxiliary,
            # six degrees of freedom of the mechanism are a proof as well, where the equations give none
            takes=lambda Ts: kin.takes(Ts) or follower.model.freedoms == 6,
        )


def _on(device: Choice | None) -> contextlib.AbstractContextManager[object]:
    """Return the block in which a device computes; without a choice, one that changes nothing."""
    if device is None:
        return contextlib.nullcontext()
    return compute_device.computing_on(device)


def loaded(robot: Robot | str | Path) -> Robot:
    """Return a robot that is given as such, by name or by path; the functions of the API take all three."""
    if isinstance(robot, Robot):
        return robot
    return load(robot)


def _is_described(path: Path) -> bool:
    """Return whether a path is that of a description file, not of a USD stage, a robot folder or a built-in robot."""
    suffix = path.suffix.lower()
    if not suffix or suffix in STAGE_SUFFIXES or path.is_dir():
        return False
    from twin.exchange.formats import import_formats

    return any(suffix in format.sources for format in import_formats())


def load(
    robot: str | Path,
    *,
    variants: Mapping[str, str] | str | None = None,
    parameters: Mapping[str, float] | None = None,
    tool: str | None = None,
    xacro: object = None,
    dh: str | None = None,
    units: str | None = None,
) -> Robot:
    """Load a robot by its name, folder, USD stage or description file.

    Args:
        robot: the name of a built-in robot, or the path of a robot folder, of a USD stage, or of a file in a format
            that `twin new` reads (URDF, MJCF, SDF, xacro, DH table). A stage or file gives a mechanism without
            equations: `forward`, `inverse` and `jacobian` are those of the mechanism.
        variants: {equation: variant}, or one name for all equations; default: the default of each equation.
        parameters: {name: value in SI} that replace published values in the equations.
        tool: frame or body of a stage or file to use as tool; default: the tool that it names, else the end of its
            longest chain.
        xacro: arguments and package folders, for a xacro: a `twin.exchange.xacro.XacroSettings`.
        dh: convention of a table of Denavit-Hartenberg parameters, if the table does not state it: "standard",
            "modified", "khalil" or "hayati".
        units: units of such a table, as "mm,deg", if the table does not state them.

    Raises:
        TwinError: there is no such robot or file, or `tool` is given for a robot whose description names its tool.

    Examples:
        >>> import twin
        >>> twin.load("sils").joints
        ('q1', 'q2', 'q3', 'q4', 'q5', 'q6')
    """
    path = Path(robot)
    if _is_described(path):
        # by name: who loads robots with equations, as `twin validate` does, loads nothing that reads other formats
        described = import_module("twin.api.imported_file").imported_file(path, tool, xacro, dh, units)
        return Robot(RobotSource(None, None, tool, described), None, variants, dict(parameters or {}))
    if xacro is not None or dh is not None or units is not None:
        raise TwinError(f"{robot}: xacro, dh and units are for a description file, such as arm.xacro or arm.csv")
    if path.suffix in STAGE_SUFFIXES:
        if not path.is_file():
            raise TwinError(f"{path}: the stage does not exist")
        admit(path)  # before USD opens it in this process: a malformed stage may crash or fill the memory
        return Robot(RobotSource(None, path, tool), None, variants, dict(parameters or {}))
    if tool is not None:
        raise TwinError(f"{robot} is neither a USD stage nor a description file: its tool is set in its description")
    files = assets.files(robot)
    hidden_folder = assets.hidden(robot)
    if hidden_folder is not None:
        logging.getLogger(__name__).warning(
            "'%s' is the built-in robot; for the robot in the folder %s write ./%s", robot, hidden_folder, robot
        )
    return Robot(RobotSource(files, None), files, variants, dict(parameters or {}))
