"""Move the mechanism along a path of driven joint values, or of tool poses.

Tool poses may be followed in some directions only. If the mechanism has fewer than six degrees of freedom, its motion
determines the other directions.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np

from twin.core import spatial
from twin.core.errors import AssemblyError
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.reference.model import ReferenceModel
from twin.reference.newton import minimise
from twin.reference.pose_residuals import posed
from twin.reference.target_continuation import GAP_TOLERANCE, MODE_JUMP, between

_MOST_HALVINGS = 8
"""Maximum number of halvings of a step between two samples; after these, the path counts as blocked."""

_NEARBY_STEP = {True: 0.05, False: 0.005}
"""Displacement of a driven joint (rad if an angle, else m) for Jacobians near a state that may be singular."""


class Follower:
    """Moves a mechanism along a path; its reference model is built at first use.

    A state is a configuration (nq,) of the reference model. A motion can start from any state.
    """

    def __init__(self, make: Callable[[], ReferenceModel]) -> None:
        self._make = make

    @cached_property
    def model(self) -> ReferenceModel:
        """The reference model of the mechanism, which does not use the robot's equations."""
        return self._make()

    def drawn(self) -> tuple[Array, Array]:
        """Return (state (nq,), q (n,)): the rest state of the CAD, and its driven joint values."""
        home = self.model.home()
        return home.x, home.q

    def carry(self, q: Array, start: Array) -> tuple[Array, Array]:
        """Return states (k, nq) and T_base_tool (k, 4, 4) for driven joint values q (k, n) along a motion from `start`.

        Raises:
            AssemblyError: the loops open during the motion; the message names the sample.
        """
        run = self.model.run(q, self.model.state(start))
        return run.x, run.Ts_base_tool

    def follow(self, Ts: Array, directions: np.ndarray, p_tool: Array, start: Array) -> tuple[Array, Array, Array]:
        """Return states (k, nq), driven joint values (k, n) and T_base_tool (k, 4, 4) along a path of tool poses.

        The poses Ts (k, 4, 4) begin near the state `start` (nq,). `directions` (6,) marks the followed directions; see
        `pose_residuals.posed`. `p_tool` (3,) in m is the followed point in the tool frame.

        Raises:
            AssemblyError: the mechanism cannot follow the path; the message names the sample.
        """
        states = []
        x = start
        T_before = self.model.collect(start[None]).Ts_base_tool[0]
        for k, T in enumerate(Ts):
            fraction = 0.0
            step = 1.0
            while fraction < 1.0:
                ahead = min(1.0, fraction + step)
                target = between(T_before, T, ahead)
                new = self._state_at(x, target, directions, p_tool)
                if new is not None:
                    x = new
                    fraction = ahead
                    step = 2 * step
                    continue
                step /= 2
                if step < 0.5**_MOST_HALVINGS:
                    best = self.model.state(x)
                    text = _stop_text(best.T_base_tool, Ts, k, directions, p_tool)
                    raise AssemblyError(text, best, best.worst_gap)
            states.append(x)
            T_before = T
        run = self.model.collect(np.array(states))
        return run.x, run.q, run.Ts_base_tool

    def jacobians(self, state: Array, p_tool: Array) -> Array:
        """Return Jacobians (k, 6, n) of a point of the tool with respect to the driven joints, linear part first.

        The first of the k states is the given state. As this state may be singular, the others are nearby states, each
        with one driven joint displaced.
        """
        model = self.model
        q = model.collect(state[None]).q[0]
        seed = model.state(state)
        states = [state]
        for i, joint in enumerate(model.mechanism.active):
            unit = np.arange(len(q)) == i
            size = _NEARBY_STEP[joint.is_angle]
            for step in (size, -size):
                try:
                    nearby = model.solve(q + step * unit, seed)
                except AssemblyError:
                    continue  # beyond the reach of the mechanism; the other direction usually closes
                states.append(nearby.x)
        X = np.array(states)
        poses, J = model.tree.update(X, closing_only=True)
        twist = model.tree.tool_jacobian(poses, J) @ model.gains(X)
        arm = model.tree.tool(poses)[:, :3, :3] @ p_tool
        twist[:, :3] -= spatial.hat(arm) @ twist[:, 3:]
        return twist

    def _state_at(self, x: Array, T: Array, directions: np.ndarray, p_tool: Array) -> Array | None:
        """Return the closed state near x with the tool at T in the chosen directions; None if none is found."""
        model = self.model
        residual = posed(model.tree, T[None], directions, p_tool)
        every = np.arange(model.tree.model.nv)
        X, converged = minimise(model.tree, x[None], residual, every)
        run = model.collect(X)
        if not converged[0] or model.jumps(x[None], X)[0] > MODE_JUMP:
            return None
        deviation = pose_difference(run.Ts_base_tool[0], T, p_tool)[directions]
        gap = run.gaps[0, :, 0].max(initial=0.0)
        misfit = max(gap, np.abs(deviation).max())
        if misfit < GAP_TOLERANCE:
            return X[0]
        return None


def _stop_text(T: Array, Ts: Array, sample: int, directions: np.ndarray, p_tool: Array) -> str:
    """Return, as text, how far the tool, stopped at T (4, 4), is from the pose of a sample and from the end of Ts."""

    def distance(goal: Array) -> str:
        deviation = pose_difference(T, goal, p_tool) * directions
        shift_mm = np.linalg.norm(deviation[:3]) / MM
        turn_deg = np.linalg.norm(deviation[3:]) / DEG
        return f"{shift_mm:.3g} mm and {turn_deg:.3g} deg"

    text = "the mechanism cannot follow: it is stretched, loops open, or the assembly mode changes"
    end = len(Ts) - 1
    to_end = distance(Ts[end])
    if sample == end:
        return f"{text}. The tool stops {to_end} before the end of the path"
    part = f"{100 * sample / end:.0f} % of the path"
    return f"{text}. The tool stops {distance(Ts[sample])} before {part}, {to_end} before its end"


def pose_difference(T: Array, goal: Array, p_tool: Array) -> Array:
    """Return the difference (6,) in base of two tool poses: shift of the point p_tool in m, rotation vector in rad."""
    R = T[:3, :3]
    R_goal = goal[:3, :3]
    point = T[:3, 3] + R @ p_tool
    goal_point = goal[:3, 3] + R_goal @ p_tool
    turn = spatial.log_so3(R @ R_goal.T)
    return np.concatenate([point - goal_point, turn])
