"""Forward, inverse and Jacobian of a robot without equations, computed from its mechanism alone."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from twin.core import spatial
from twin.core.errors import AssemblyError, KinematicsError, MechanismError
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.kinematics.closed_loops import LoopSolver
from twin.reference import ReferenceModel
from twin.reference.joint_range import joint_range
from twin.reference.states import Assembly

_REACHED_WITHIN = 1e-6
"""Largest difference of a tool pose from the requested pose, in m and rad."""

_FREEDOMS_OF_A_POSE = 6

_SEARCH_STARTS = 128
"""Number of states over the joint range from which a pose is searched that is not found from the seed."""


class MechanismKinematics:
    """Kinematics of a mechanism with or without loops, with the arguments and results of equations.

    Forward uses the compiled loops, inverse and Jacobian the reference model. All continue from the rest poses, or from
    a seed, so they stay on that branch. Joint limits are not checked.
    """

    def __init__(self, loops: LoopSolver, model: ReferenceModel) -> None:
        """Use the loops and the reference model of one mechanism."""
        self._loops = loops
        self._model = model

    def forward(self, q: Array, seed: Array | None = None) -> Array:
        """Return T_base_tool (4, 4) at q (n,), from the rest poses or from the assembly at the seed pose (4, 4).

        Raises:
            KinematicsError: the loops cannot be closed at q, or the mechanism does not reach the seed pose.
            MechanismError: q has the wrong length or is not finite.
        """
        if seed is None:
            try:
                return self._loops.forward(q)
            except AssemblyError as error:
                raise KinematicsError(str(error)) from error
        return self._assembly(q, seed).T_base_tool

    def forward_many(self, qs: Array, seed: Array | None = None) -> Array:
        """Return T_base_tool (k, 4, 4) at qs (k, n); poses without a solution are NaN.

        Raises:
            KinematicsError: the mechanism does not reach the seed pose (4, 4).
            MechanismError: the rows have the wrong length.
        """
        if seed is None:
            return self._loops.forward_many(qs).Ts_base_tool
        model = self._model
        start = self._at(seed)
        count = len(model.mechanism.active)
        if qs.ndim != 2 or qs.shape[1] != count:
            raise MechanismError(f"q has shape {qs.shape}; expected (k, {count})")
        Ts = np.full((len(qs), 4, 4), np.nan)
        for k, q in enumerate(qs):
            if not np.isfinite(q).all():
                continue
            try:
                Ts[k] = model.solve(q, start).T_base_tool
            except AssemblyError:  # no solution: the row stays NaN
                continue
        return Ts

    def inverse(self, T_base_tool: Array, seed: Array | None = None) -> Array:
        """Return q (n,) at a pose (4, 4), from the rest poses or from q (n,) `seed`.

        The tool is moved to the pose; where the mechanism cannot follow, the pose is searched from the start and from
        states over the range of the joints, and the solution nearest to the start is returned.

        Raises:
            KinematicsError: no assembly was found whose tool is at this pose, or the loops are open at the seed.
            MechanismError: the pose is not rigid, or the seed has the wrong length.
        """
        model = self._model
        start = model.home()
        if seed is not None:
            try:
                start = model.solve(seed)
            except AssemblyError as error:
                raise KinematicsError(f"the seed: {error}") from error
        return self._assembly_at(T_base_tool, start, same_branch=True).q

    def _assembly_at(self, T_base_tool: Array, start: Assembly, same_branch: bool) -> Assembly:
        """Return an assembly with the tool at a pose (4, 4): by a motion from `start`, else the nearest that is found.

        With `same_branch`, a searched assembly must be the one that `forward` gives for its joints.

        Raises:
            KinematicsError: no such assembly was found.
            MechanismError: the pose is not rigid.
        """
        T = np.asarray(T_base_tool, float)
        try:
            assembly = self._model.solve_pose(T, start)
        except AssemblyError as error:
            assembly = error.best
        if isinstance(assembly, Assembly) and self._is_at(assembly.T_base_tool, T):
            return assembly
        # the start alone first: one solve instead of `_SEARCH_STARTS`, and its answer is most often on the same branch
        for states in (start.x[None], self._spread):
            state = self._nearest(states, T, start, same_branch)
            if state is not None:
                return self._model.state(state)
        raise KinematicsError(self._unreached(assembly, T))

    def _nearest(self, states: Array, T_base_tool: Array, start: Assembly, same_branch: bool) -> Array | None:
        """Return the configuration (nq,) at a pose, found from rows of X, whose joints are nearest to the start."""
        run = self._model.collect(self._model.near_pose(states, T_base_tool))
        if not len(run.x):
            return None
        Ts = run.Ts_base_tool
        if same_branch:
            # one q can have several assemblies: the tool must be where `forward` places it for this q
            Ts = self._loops.forward_many(run.q).Ts_base_tool
        best = None
        smallest = np.inf
        for state, q, T_found in zip(run.x, run.q, Ts, strict=True):
            distance = np.abs(q - start.q).max(initial=0.0)
            if self._is_at(T_found, T_base_tool) and distance < smallest:
                best = state
                smallest = distance
        return best

    @cached_property
    def _spread(self) -> Array:
        """Configurations (k, nq) over the range of the driven joints."""
        return joint_range(self._model, _SEARCH_STARTS).run.x

    def _unreached(self, nearest: object, T_base_tool: Array) -> str:
        """Return the message that a pose is not reached."""
        name = self._model.mechanism.name
        text = f"{name}: the mechanism was not found to reach the pose"
        if not isinstance(nearest, Assembly):
            return text
        shift, angle = spatial.pose_difference(nearest.T_base_tool, T_base_tool)
        freedoms = self._model.freedoms
        text += f": on the way to it, {shift / MM:.3g} mm and {angle / DEG:.3g}° remain"
        if freedoms < _FREEDOMS_OF_A_POSE:
            text += f" (it has {freedoms} degrees of freedom, so that most poses are out of its reach)"
        return text

    @staticmethod
    def _is_at(T_base_tool: Array, T_requested: Array) -> bool:
        return bool(np.abs(T_base_tool - T_requested).max() <= _REACHED_WITHIN)

    def inverse_of_all(self, Ts: Array, seed: Array | None = None) -> Array:
        """Return q (k, n) at poses (k, 4, 4), each from the solution of the pose before, the first as `inverse`.

        Raises:
            KinematicsError: a pose has no solution; the message names its index.
        """
        q = np.zeros((len(Ts), len(self._model.mechanism.active)))
        start = seed
        for k, T in enumerate(Ts):
            try:
                q[k] = self.inverse(T, start)
            except (KinematicsError, MechanismError) as error:
                raise KinematicsError(f"pose {k} (of 0 .. {len(Ts) - 1}): {error}") from error
            start = q[k]
        return q

    def jacobian(self, q: Array, seed: Array | None = None) -> Array:
        """Return the Jacobian (6, n) from rates of the active joints to the tool twist in base, linear rows first.

        Raises:
            KinematicsError: the loops cannot be closed at q, or the mechanism does not reach the seed pose (4, 4).
        """
        state = self._assembly(q, seed)
        return self._model.tool_jacobians(state.x[None])[0]

    def _assembly(self, q: Array, seed: Array | None) -> Assembly:
        """Return the assembly at q (n,), from the rest poses or from the assembly at the seed pose (4, 4)."""
        start = None
        if seed is not None:
            start = self._at(seed)
        try:
            return self._model.solve(q, start)
        except AssemblyError as error:
            raise KinematicsError(str(error)) from error

    def _at(self, T_base_tool: Array) -> Assembly:
        """Return the assembly with the tool at a seed pose (4, 4)."""
        try:
            return self._assembly_at(T_base_tool, self._model.home(), same_branch=False)
        except (KinematicsError, MechanismError) as error:
            raise KinematicsError(f"the seed is not a pose of the mechanism: {error}") from error
