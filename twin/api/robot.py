"""A robot: its mechanism, its equations, and what both answer."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from twin.api.robot_source import RobotSource
from twin.core import assets, compute_device
from twin.core.errors import TwinError, unknown
from twin.core.foreign.budget import read_bytes
from twin.core.progress import Progress as Progress  # a name of twin.api
from twin.core.spatial import Array

if TYPE_CHECKING:
    from twin.cad.build import CadModel
    from twin.core.compute_device import Choice
    from twin.kinematics import Formula, Kinematics, Solution, Task
    from twin.kinematics.closed_loops import LoopSolver
    from twin.kinematics.closed_loops.passive_limits import PassiveCheck
    from twin.kinematics.compiled import ExtraJoint
    from twin.model.mechanism import Mechanism
    from twin.planning.link_motion import LinkMotion
    from twin.planning.path_kinematics import PathKinematics
    from twin.planning.protocol import Protocol, Solver
    from twin.planning.trajectory import Trajectory
    from twin.reference import ReferenceModel
    from twin.reference.dynamics import Dynamics


@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    """A robot: its mechanism from the CAD (or a stage or file) and its equations. Made by `load`; immutable.

    Arrays are in SI units; poses are T_base_tool (4, 4); q (n,) has the values of the active joints, in the order of
    `joints`. CAD and equations are loaded when first used. `bound`, `weighed` and `with_...` return new robots with the
    same source. Without equations, `forward`, `inverse` and `jacobian` are those of the mechanism.

    Attributes:
        source: the CAD, stage or description file from which the robot is read.
        chosen_variants: {equation: variant}, one name for all equations, or None (the default of each equation).
        parameters: values (SI) by name that replace published values in the equations.
        trocars: {trocar: position (3,) in m in the base frame} that replace the positions of the description.
        is_weighed: whether the masses of the bodies are computed.
        given_mechanism: mechanism that replaces the mechanism of the source (a design, a seeded fault), or None.
        given_formula: formula that replaces the formula of the source, or None.
        timing: solver of the timing of all protocols, "passes" or "toppra"; None: each protocol names its solver.
        inverse_by: what gives the joint values of planned poses: "equations", or "points", the published optimisation.
    """

    source: RobotSource
    chosen_variants: Mapping[str, str] | str | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    trocars: Mapping[str, Array] = field(default_factory=dict)
    is_weighed: bool = False
    given_mechanism: Mechanism | None = None
    given_formula: Formula | None = None
    timing: Solver | None = None
    inverse_by: Literal["equations", "points"] = "equations"

    @property
    def files(self) -> assets.RobotFiles | None:
        """Files of the robot; None if it was loaded from a stage or a description file."""
        return self.source.files

    @property
    def name(self) -> str:
        """Name of the robot's folder, or of the file of the stage or description."""
        return self.source.name

    def hashes(self) -> dict[str, str]:
        """Return {file of equations or mechanism: SHA-256 of its bytes}; empty for a robot without files."""
        if self.files is None:
            return {}
        return self.files.hashes()

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
        mechanism = self._with_trocars(self.given_mechanism or cad.mechanism)
        return replace(cad, mechanism=mechanism)

    @cached_property
    def mechanism(self) -> Mechanism:
        """Bodies, joints and loops, from the CAD, the stage or the description file."""
        if self.source.path is None:
            return self.cad.mechanism
        if self.given_mechanism is not None:
            return self._with_trocars(self.given_mechanism)
        mechanism, _ = self.source.opened
        return self._with_trocars(mechanism)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the active joints, in the order of q."""
        return tuple(joint.name for joint in self.mechanism.active)

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the robot's frames."""
        return tuple(frame.name for frame in self.mechanism.frames)

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

    def _with_trocars(self, mechanism: Mechanism) -> Mechanism:
        """Return a mechanism with the trocars that this robot has elsewhere than its source."""
        if not self.trocars:
            return mechanism
        return mechanism.with_trocars(self.trocars)

    @cached_property
    def has_equations(self) -> bool:
        """Whether the robot has equations; without them, its mechanism answers `forward`, `inverse` and `jacobian`."""
        if self.given_formula is not None:
            return True
        return self.files is not None and self.files.has_equations

    @property
    def unwritten(self) -> bool:
        """Whether the robot's formula.py is still the empty template."""
        return self.files is not None and self.files.formula.is_file() and not self.files.has_equations

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

        if self.given_formula is not None:
            return self.given_formula
        path = assets.equations(self.files, self.name)
        read = read_bytes if self.files is None else self.files.read
        return load_formula(path, self.name, lambda: self.mechanism.driven, read=read)

    @property
    def variants(self) -> dict[str, tuple[str, ...]]:
        """{equation: names of its variants}."""
        return dict(self._kinematics.choices)

    @cached_property
    def loops(self) -> LoopSolver:
        """Compiled solver of the mechanism's loop closure, which does not use formula.py."""
        from twin.kinematics.closed_loops import LoopSolver

        return LoopSolver(self.mechanism)

    @cached_property
    def _mechanism_kinematics(self) -> Any:
        """A `twin.api.mechanism_kinematics.MechanismKinematics`; by name, as robots with equations do not need it."""
        module = import_module("twin.api.mechanism_kinematics")
        return module.MechanismKinematics(self.loops, self.reference())

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
        with _computing_on(device):
            kin = self._solver(variant)
            if T.ndim == 2:
                return kin.inverse(T, seed)
            return kin.inverse_of_all(T, seed)

    def _solver(self, variant: Mapping[str, str] | str | None) -> Any:
        """Return what computes poses and joint values: the equations or, without them, the mechanism."""
        if variant is None and not self.has_equations:
            return self._mechanism_kinematics
        return self.kinematics(variant)

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
        with _computing_on(device):
            kin = self._solver(variant)
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
            return self._mechanism_kinematics.jacobian(np.asarray(q, float), seed)
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
            TwinError: the protocol does not exist, is written for another robot, or its file is malformed.
        """
        protocol = self.source.protocol(name)
        if self.timing is None:
            return protocol
        return replace(protocol, timing=self.timing)

    def path_kinematics(self) -> PathKinematics:
        """Return the limits, the equations (if the robot has any) and the mechanism, for planning.

        Raises:
            TwinError: the driven joints of equations and mechanism differ, or the equations are missing or malformed.
        """
        from twin.api.path_kinematics import of_mechanism, with_equations
        from twin.reference.follower import Follower

        follower = Follower(self.reference)
        by_mechanism = of_mechanism(self.name, self.mechanism, follower, self.gaps, lambda: self.passive_check)
        if self.unwritten:
            return by_mechanism
        return with_equations(by_mechanism, self.name, self._kinematics, follower, self.inverse_by)

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
    def passive_check(self) -> PassiveCheck:
        """Check of the limits of passive joints at many tool poses, by the compiled loops."""
        from twin.kinematics.closed_loops.passive_limits import PassiveCheck

        return PassiveCheck(self.loops)

    def bound(self, protocol: Protocol) -> Robot:
        """Return the robot with its trocars at the positions that the protocol states; without any, the same robot.

        Mechanism and equations get the same positions.

        Raises:
            TwinError: the mechanism has no such trocar.
        """
        trocars = self.mechanism.trocars
        places = protocol.places_of(trocars)
        if not places:
            return self
        coordinates = _trocar_parameters(trocars, places)
        return replace(self, parameters={**self.parameters, **coordinates}, trocars={**self.trocars, **places})

    def with_parameters(self, values: Mapping[str, float]) -> Robot:
        """Return the robot with these parameter values (SI) in its equations."""
        return replace(self, parameters={**self.parameters, **values})

    def with_mechanism(self, mechanism: Mechanism) -> Robot:
        """Return the robot with another mechanism, including its masses, instead of the mechanism of its source."""
        return replace(self, given_mechanism=mechanism)

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
        return replace(self, given_formula=formula)

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


def _trocar_parameters(trocars: Sequence[str], places: Mapping[str, Array]) -> dict[str, float]:
    """Return the parameters of equations, in m, for {trocar: position (3,) in base}.

    They are trocar_x, trocar_y, trocar_z for the only trocar of a mechanism, trocar_NAME_x, ... if there are several.
    `trocars` are the names of all trocars of the mechanism.
    """
    coordinates: dict[str, float] = {}
    for name, place in places.items():
        prefix = "trocar" if len(trocars) == 1 else f"trocar_{name}"
        for axis, value in zip("xyz", place, strict=True):
            coordinates[f"{prefix}_{axis}"] = float(value)
    return coordinates


def _computing_on(device: Choice | None) -> contextlib.AbstractContextManager[object]:
    """Return the block in which a device computes; without a choice, one that changes nothing."""
    if device is None:
        return contextlib.nullcontext()
    return compute_device.computing_on(device)
