"""Drag a robot: compiled loop equations move the mechanism, then the independent model closes the loops.

The result of the compiled equations is only the initial guess of the independent model, which computes poses and gaps.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from twin.core.errors import AssemblyError, MechanismError
from twin.core.spatial import Array
from twin.kinematics.closed_loops.bounds import bounds_of
from twin.kinematics.closed_loops.dragging import Dragged, Dragger, GrabbedPoint
from twin.kinematics.closed_loops.grip import DragGrip
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel
from twin.reference.states import Assembly

_WITH_QUATERNION = ("spherical", "free")
"""Types of passive joints whose state ends with a quaternion: w, x, y, z in the compiled equations."""

STEP_SECONDS = 0.014
"""Processor time in s after which a drag step stops; the next call continues."""


class DragSolver:
    """Solver that moves a mechanism; the loop equations are compiled at the first move, or earlier by `prepare`.

    Attributes:
        bounds: limits of joints, of motors, and of the distances of joints on a common rail.
    """

    def __init__(self, mechanism: Mechanism, model: ReferenceModel, gaps: Sequence[tuple[str, str, float]]) -> None:
        """Create the solver; `gaps`: (lower joint, upper joint, minimum distance in m) of joints on a common rail."""
        self.mechanism = mechanism
        self.model = model
        self.bounds = bounds_of(mechanism, gaps)
        self._last: tuple[Assembly, str, Array, DragGrip] | None = None

    @cached_property
    def dragger(self) -> Dragger:
        """The compiled loop equations, starting at the home state.

        Raises:
            AssemblyError: the loops cannot be closed at the home state.
        """
        return Dragger(self.mechanism.with_rest(self.model.home().link_poses), self.bounds)

    def prepare(self) -> None:
        """Compile the loop equations, so that the first drag does not wait; only the first drag raises an error."""
        with contextlib.suppress(AssemblyError, MechanismError):
            dragger = self.dragger
            home = self.model.home()
            u = self._unknowns(home)
            dragger.move_joints(home.q, u, home.q)
            for body in self.mechanism.bodies:
                dragger.linearize(home.q, u, body.name, np.zeros(3))

    def point(self, now: Assembly, body: str, p_body: Array, target: Array) -> tuple[Assembly, Dragged]:
        """Move the point `p_body` of a body towards `target`.

        `p_body` (3,) is in m in the frame of the body, `target` (3,) in m in the base frame. Return the new
        assembly and the result of the compiled equations. The path starts at the last target if nothing else has moved
        the robot since the last drag, otherwise at the present position of the point.
        """
        p_body = np.asarray(p_body, float)
        grip = None
        if self._last is not None:
            last_assembly, last_body, last_point, last_grip = self._last
            if last_assembly is now and last_body == body and np.array_equal(last_point, p_body):
                grip = last_grip
        if grip is None:
            grip = DragGrip(self.dragger, now.q, self._unknowns(now), GrabbedPoint(body, p_body))
        dragged = grip.to(target, STEP_SECONDS)
        assembly = self._closed(now, dragged)
        self._last = (assembly, body, p_body, grip)
        return assembly, dragged

    def joints(self, assembly: Assembly, q: Array) -> tuple[Assembly, Dragged]:
        """Move the active joints towards q (n,) in m or rad; return (new assembly, result), as `point` does."""
        dragged = self.dragger.move_joints(assembly.q, self._unknowns(assembly), q, STEP_SECONDS)
        return self._closed(assembly, dragged), dragged

    def tools(self, assembly: Assembly, q: Array) -> list[Array]:
        """Return the tool pose (4, 4) at q (n,) for each initial guess from which the loops can be closed.

        The initial guesses are the home state, the present state, and the present state dragged to q.
        """
        dragger = self.dragger
        poses = []
        with contextlib.suppress(AssemblyError, MechanismError):
            poses.append(dragger.solver.forward(q))
        u_now = self._unknowns(assembly)
        u_dragged = dragger.move_joints(assembly.q, u_now, q, STEP_SECONDS).u
        for guess in (u_now, u_dragged):
            u = dragger.solver.close(q, guess)
            if u is not None:
                poses.append(dragger.solver.pose(q, u))
        return poses

    def _closed(self, assembly: Assembly, dragged: Dragged) -> Assembly:
        """Return the assembly of the independent model, solved with the compiled result as initial guess."""
        if np.array_equal(dragged.q, assembly.q):
            return assembly
        x = assembly.x.copy()
        tree = self.model.tree
        for joint, value in zip(self.mechanism.active, dragged.q, strict=True):
            x[tree.configuration[joint.name]] = value
        first = 0
        for passive in self.dragger.solver.equations.passive:
            state = dragged.u[first : first + passive.state.numel()]
            first += len(state)
            if passive.joint.type in _WITH_QUATERNION:
                state = np.append(state[:-4], np.roll(state[-4:], -1))  # Pinocchio stores quaternions as x, y, z, w
            x[self._coordinates(passive.name, len(state))] = state
        return self.model.solve(dragged.q, replace(assembly, x=x))

    def _unknowns(self, assembly: Assembly) -> Array:
        parts = []
        for passive in self.dragger.solver.equations.passive:
            state = assembly.x[self._coordinates(passive.name, passive.state.numel())]
            if passive.joint.type in _WITH_QUATERNION:
                state = np.append(state[:-4], np.roll(state[-4:], 1))
            parts.append(state)
        # without passive joints, concatenate would refuse an empty list
        return np.concatenate([*parts, []])

    def _coordinates(self, joint: str, count: int) -> slice:
        """Return the indices in x of a joint's last `count` coordinates; a cylindrical joint has its slide first."""
        tree = self.model.tree
        model = tree.model.joints[tree.joint_id[joint]]
        end = model.idx_q + model.nq
        return slice(end - count, end)
