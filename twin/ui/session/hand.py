"""The hand on a robot: compiled loops lead the mechanism to where the independent model then closes it.

What leading found is only where the independent model begins: poses, gaps and what the instruments read are its own.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from twin.core.errors import AssemblyError, MechanismError
from twin.core.spatial import Array
from twin.kinematics.closed_loops.leading import Grip, Leader, Led, bounds_of
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel
from twin.reference.states import Assembly

SECONDS = 0.014
"""Processor time after which leading stops; what is left of the way is for the next call."""


class Hand:
    """Leads one mechanism; what it needs is compiled when it first does, or by `prepare`.

    Attributes:
        gaps: lower joint, upper joint, minimum distance in m, of joints that share a rail.
    """

    def __init__(self, mechanism: Mechanism, model: ReferenceModel, gaps: Sequence[tuple[str, str, float]]) -> None:
        self.mechanism, self.model, self.gaps = mechanism, model, tuple(gaps)
        self.bounds = bounds_of(mechanism, gaps)
        self._last: tuple[Assembly, str, Array, Grip] | None = None

    @cached_property
    def leader(self) -> Leader:
        """The compiled loops, from the state that the independent model closed (`AssemblyError`: it could not)."""
        return Leader(self.mechanism.with_rest(self.model.home().link_poses), self.bounds)

    def prepare(self) -> None:
        """Compile, so that the first drag does not wait; a mechanism that cannot be led says so when it is."""
        with contextlib.suppress(AssemblyError, MechanismError):
            leader, home = self.leader, self.model.home()
            u = self._unknowns(home)
            leader.joints(home.q, u, home.q)
            for body in self.mechanism.bodies:
                leader.look(home.q, u, body.name, np.zeros(3))

    def point(self, now: Assembly, body: str, p_body: Array, target: Array) -> tuple[Assembly, Led]:
        """Lead a point (3,) of a body towards a target (3,) in base, in m.

        The way begins where the hand was last, if nothing else has moved the robot since; else at the point.
        """
        last, p_body = self._last, np.asarray(p_body, float)
        if last is not None and last[0] is now and last[1] == body and np.array_equal(last[2], p_body):
            grip = last[3]
        else:
            grip = self.leader.take(now.q, self._unknowns(now), body, p_body)
        led = grip.to(target, SECONDS)
        found = self._closed(now, led)
        self._last = (found, body, p_body, grip)
        return found, led

    def joints(self, now: Assembly, q: Array) -> tuple[Assembly, Led]:
        """Lead the active joints towards q (n,) in m or rad."""
        led = self.leader.joints(now.q, self._unknowns(now), q, SECONDS)
        return self._closed(now, led), led

    def tools(self, now: Assembly, q: Array) -> list[Array]:
        """Return the tool poses (4, 4) of the assemblies at q (n,) that are near at hand: as drawn, and from here."""
        leader, out = self.leader, []
        with contextlib.suppress(AssemblyError, MechanismError):
            out.append(leader.solver.forward(q))
        here = self._unknowns(now)
        for seed in (here, leader.joints(now.q, here, q, SECONDS).u):
            found = leader.solver.close(q, seed)
            if found is not None:
                out.append(leader.solver.pose(q, found))
        return out

    def _closed(self, now: Assembly, led: Led) -> Assembly:
        """Return the assembly of the independent model at what leading found."""
        if np.array_equal(led.q, now.q):
            return now
        x, tree, at = now.x.copy(), self.model.tree, 0
        for joint, value in zip(self.mechanism.active, led.q, strict=True):
            x[tree.configuration[joint.name]] = value
        for passive in self.leader.solver.equations.passive:
            state = led.u[at : at + passive.state.numel()]
            at += len(state)
            if passive.joint.type in ("spherical", "free"):
                state = np.append(state[:-4], np.roll(state[-4:], -1))  # Pinocchio stores the scalar last
            x[self._places(passive.name, len(state))] = state
        return self.model.solve(led.q, replace(now, x=x))

    def _unknowns(self, now: Assembly) -> Array:
        parts = []
        for passive in self.leader.solver.equations.passive:
            state = now.x[self._places(passive.name, passive.state.numel())]
            if passive.joint.type in ("spherical", "free"):
                state = np.append(state[:-4], np.roll(state[-4:], 1))
            parts.append(state)
        return np.concatenate([*parts, []])

    def _places(self, joint: str, count: int) -> slice:
        """Return where the numbers of a passive joint stand in a configuration; those of a slide come first."""
        tree = self.model.tree
        model = tree.model.joints[tree.joint_id[joint]]
        end = model.idx_q + model.nq
        return slice(end - count, end)
