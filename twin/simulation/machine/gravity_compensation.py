"""Gravity compensation of a machine's control software: the joint efforts that balance gravity, compiled."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace

import casadi as ca
import numpy as np

from twin.codegen import Kernel, Stage
from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.kinematics.closed_loops.solver import LoopSolver
from twin.model.inertia import Inertia
from twin.model.mechanism import Mechanism
from twin.simulation.machine.equations_of_motion import motion
from twin.simulation.machine.settings import Settings

GravityEfforts = Callable[[Array], Array]
"""Function from joint values (n,) to the joint efforts (n,) in N m or N that balance gravity."""


def compensation(settings: Settings, mechanism: Mechanism) -> GravityEfforts:
    """Return the function q (n,) -> joint efforts (n,) that balance gravity on the point masses of the settings.

    Without point masses in the settings, the efforts balance gravity on the masses of the mechanism.

    Raises:
        MechanismError: a point mass names a frame that is not on the body of its joint.
    """
    if not settings.compensation:
        return holding(mechanism)
    frames_by_name = {frame.name: frame for frame in mechanism.frames}
    masses = {}
    for point in settings.compensation:
        body = mechanism.joint(point.joint).child
        frame = frames_by_name.get(point.frame)
        if frame is None or frame.body != body:
            raise MechanismError(f"compensation of {point.joint}: {body} has no frame '{point.frame}'")
        T_body_frame = frame.T_body_frame
        p_body_com = T_body_frame[:3, :3] @ np.array(point.centre) + T_body_frame[:3, 3]
        masses[body] = Inertia(point.mass, p_body_com, np.zeros((3, 3)))
    bodies = []
    for body in mechanism.bodies:
        bodies.append(replace(body, inertia=masses.get(body.name)))
    return holding(replace(mechanism, bodies=tuple(bodies)))


def holding(mechanism: Mechanism) -> GravityEfforts:
    """Return the compiled function q (n,) -> joint efforts (n,) that balance gravity on a mechanism's masses."""
    if mechanism.loops:
        return LoopHolding(mechanism)
    return _kernel(mechanism).single()


class LoopHolding:
    """The same function for a mechanism with loops, which are closed from those of the last call.

    Machines that share their parts therefore need one each: `another`.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        """Compile the function; the first call closes the loops from the posture of the CAD."""
        self._solver = LoopSolver(mechanism)
        self._efforts = _kernel(mechanism, self._solver).single()
        self._states: Array | None = None

    def another(self) -> LoopHolding:
        """Return the same function, whose first call closes the loops from the posture of the CAD."""
        efforts = copy(self)
        efforts._states = None
        return efforts

    def __call__(self, q: Array) -> Array:
        """Return the joint efforts (n,) at joint values q (n,).

        Raises:
            MechanismError: the loops cannot be closed at q.
        """
        states = None
        if self._states is not None:
            states = self._solver.close(q, self._states)
        if states is None:
            solved = self._solver.forward_many(q[None])
            if not np.isfinite(solved.Ts_base_tool).all():
                raise MechanismError(f"the measured joint values {np.round(q, 6).tolist()} do not close the loops")
            states = solved.states[0]
        self._states = states
        return self._efforts(np.concatenate([q, states]))


def _kernel(mechanism: Mechanism, solver: LoopSolver | None = None) -> Kernel:
    """Return the function of joint values, then the states of the passive joints, to the joint efforts."""
    equations = motion(mechanism, solver)
    # At rest, only gravity is left of the efforts b.
    efforts = ca.substitute(equations.b, equations.qd, ca.DM.zeros(equations.qd.shape))
    efforts = ca.substitute(efforts, equations.factors, ca.DM.ones(equations.factors.shape))
    efforts = ca.substitute(efforts, equations.fall, ca.DM(mechanism.gravity))
    state = ca.SX.sym("q", equations.q.numel() + equations.states.numel())
    efforts = ca.substitute(ca.densify(ca.simplify(efforts)), ca.vertcat(equations.q, equations.states), state)
    g = ca.Function("gravity", [state], [efforts], {"cse": True})
    stage = Stage(g, ("q",), ("g",))
    return Kernel([stage], {"q": state.numel()}, ["g"], single=True)
