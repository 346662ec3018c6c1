"""Inverse and forward dynamics of any mechanism, with loops, in its active joints.

    M(q) qdd + C(q, qd) qd + g(q) + F qd = tau

Pinocchio computes the equations of the spanning tree in its velocities V (composite rigid bodies, recursive
Newton-Euler). Loops and couplings, A V = 0, are included by projection on the active joints: V = G qd and dV/dt = G qdd
- A_p^+ (dA/dt V), where A_p are the columns of A for the passive joints. By virtual work, tau = G^T tau_tree, because
the forces in the loops do no work. Rotors turn with the motors, m = T^-1 q, where T is the matrix of the transmission;
the rotor inertias J_m are thus equivalent to T^-T J_m T^-1 at the joints.

Sources: R. Featherstone, Rigid Body Dynamics Algorithms, Springer 2008, chapters 5, 6 and 8; R. M. Murray, Z. Li,
S. S. Sastry, A Mathematical Introduction to Robotic Manipulation, CRC Press 1994, sections 4.3 and 6.1; Y. Nakamura,
M. Ghodoussi, Dynamics computation of closed-link robot mechanisms with nonredundant and redundant actuators, IEEE
Trans. Robotics and Automation 5 (1989) 294-302. docs/derivations.md has the derivation.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports] - installed beside site-packages
from numpy.typing import ArrayLike
from scipy.linalg import null_space

from twin.core.errors import MechanismError
from twin.core.spatial import Array, Index
from twin.model.mechanism import Mechanism
from twin.reference.continuation import LoopContinuation
from twin.reference.model import ReferenceModel, checked_joint_motion, checked_joint_values
from twin.reference.states import Assembly

_NO_INERTIA = 1e-12
"""Inertia in kg m2 or kg below which a joint counts as moving no mass: far below real parts, above rounding errors."""

_RELATIVE_ZERO = 1e-9
"""Singular values below this fraction of the largest one count as zero."""

State = ArrayLike | Assembly
"""A state: active joint values q (n,) in m or rad, or a solved assembly (to choose an assembly mode)."""


class Dynamics:
    """Equations of motion in the n active joints, in the order of `mechanism.active`.

    Efforts are in N m for angles and in N for lengths; inertias are in kg m2, kg m or kg accordingly. A state is either
    q (n,) or an `Assembly` of `model`. For q, loops are closed starting from home; an `Assembly` is used unchanged.

    Attributes:
        mechanism: the mechanism with masses; a body without inertia is massless.
        rotor: (n, n) inertia of the rotors, referred to the joints.
        friction: (n,) viscous friction, N m s/rad or N s/m.
    """

    def __init__(
        self,
        mechanism: Mechanism | ReferenceModel,
        *,
        rotor: ArrayLike = 0.0,
        friction: ArrayLike = 0.0,
    ) -> None:
        """Set up the equations from the masses of a mechanism and the rotors of its actuators.

        Args:
            mechanism: the mechanism, or its independent model.
            rotor: (n,) rotor inertia at the joints in kg m2 or kg, in addition to the rotors of the actuators.
            friction: (n,) viscous friction at the joints, N m s/rad or N s/m.

        Raises:
            MechanismError: rotor or friction does not have n finite numbers of at least 0.
        """
        if not isinstance(mechanism, ReferenceModel):
            mechanism = ReferenceModel(mechanism)
        self.model = mechanism
        self.mechanism = m = mechanism.mechanism
        self._tree = mechanism.tree
        self._model_with_masses = pin.Model(self._tree.model)
        self._model_with_masses.gravity.linear = np.asarray(m.gravity, float)
        self._data = self._model_with_masses.createData()
        self._active_places = self._tree.active_places
        nv = self._model_with_masses.nv
        self._upper_weights = np.triu(np.ones((nv, nv)), 1) + 0.5 * np.eye(nv)  # half of the diagonal; see `_tree_mass`
        self._has_loops = bool(m.loops)  # couplings alone are linear: their gain is constant
        self.friction = self._per_joint("friction", friction)
        rotor_inertia: dict[str, float] = {}
        for actuator in m.actuators:
            rotor_inertia[actuator.name] = actuator.rotor_inertia or 0.0
        # a motor without an actuator in the description has no known rotor
        motors = np.array([rotor_inertia.get(name, 0.0) for name in m.motor_names])
        T_inverse = m.motors(np.eye(self.n)).T
        rotors = T_inverse.T @ (motors[:, None] * T_inverse)
        self.rotor = rotors + np.diag(self._per_joint("rotor", rotor))

    @property
    def n(self) -> int:
        """Number of active joints."""
        return len(self.mechanism.active)

    def _per_joint(self, name: str, values: ArrayLike) -> Array:
        """Return one value of a parameter for each active joint, (n,)."""
        values = np.asarray(values, float)
        if values.ndim == 0:
            values = np.full(self.n, float(values))
        possible = np.isfinite(values) & (values >= 0)
        if values.shape != (self.n,) or not possible.all():
            raise MechanismError(f"{name}: {self.n} finite numbers of at least 0 are needed, not {values}")
        return values

    # -- the terms of the equations -------------------------------------------------------------------

    def configuration(self, at: State) -> Array:
        """Return the configuration (nq,) of the tree for a state.

        Raises:
            AssemblyError: the loops cannot be closed at q.
            MechanismError: q does not have n finite numbers.
        """
        if isinstance(at, Assembly):
            return at.x
        q = checked_joint_values(self.mechanism, np.asarray(at, float))
        if self._has_loops:
            return self.model.solve(q).x
        x = self._home.copy()
        x[self._followers] += self._follower_gain @ (q - x[self._active_places])
        x[self._active_places] = q
        return x

    def near(self, q: ArrayLike, before: State | None = None) -> State:
        """Return the state at q (n,); loops are closed starting from the assembly `before`, if given, or from home."""
        if not self._has_loops:
            return np.asarray(q, float)
        seed = None
        if isinstance(before, Assembly):
            seed = before
        return self.model.solve(np.asarray(q, float), seed)

    def tools(self, q: ArrayLike) -> Array:
        """Return T_base_tool (k, 4, 4) for joint values q (k, n) along a motion."""
        q = checked_joint_motion(self.mechanism, np.asarray(q, float))
        if self._has_loops:
            return self.model.run(q).Ts_base_tool
        X = np.tile(self._home, (len(q), 1))
        change = q - X[:, self._active_places]
        X[:, self._followers] += change @ self._follower_gain.T
        X[:, self._active_places] = q
        poses, _ = self._tree.update(X, closing_only=True)
        return self._tree.tool(poses)

    def mass_matrix(self, at: State) -> Array:
        """Return the mass matrix M (n, n) at a state, including the rotors.

        Raises:
            MechanismError: a passive joint that no loop determines moves a body with mass. `bias`, `inverse` and
                `forward` also raise this error.
        """
        return self._mass(self._determined(at))

    def gravity(self, at: State) -> Array:
        """Return g (n,): the efforts that keep a state at rest; a joint without drive or loop counts as fixed."""
        x = self.configuration(at)
        tree_efforts = np.array(pin.computeGeneralizedGravity(self._model_with_masses, self._data, x))
        return self._gain(x).T @ tree_efforts

    def coriolis(self, at: State, qd: ArrayLike) -> Array:
        """Return C(q, qd) qd (n,): Coriolis and centrifugal efforts at rates qd (n,)."""
        return self.bias(at, qd) - self.gravity(at)

    def bias(self, at: State, qd: ArrayLike) -> Array:
        """Return C(q, qd) qd + g(q) (n,): the efforts without the terms of acceleration and friction."""
        x = self._determined(at)
        return self._newton_euler(x, np.asarray(qd, float), np.zeros(self.n))

    def inverse(self, at: State, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """Return the joint efforts (n,) for accelerations qdd (n,) at a state and rates qd (n,)."""
        qd = np.asarray(qd, float)
        qdd = np.asarray(qdd, float)
        efforts = self._newton_euler(self._determined(at), qd, qdd)
        return efforts + self.rotor @ qdd + self.friction * qd

    def forward(self, at: State, qd: ArrayLike, efforts: ArrayLike) -> Array:
        """Return the joint accelerations (n,) caused by joint efforts (n,) at a state and rates qd (n,)."""
        x = self._determined(at)
        qd = np.asarray(qd, float)
        bias = self._newton_euler(x, qd, np.zeros(self.n))
        free = np.asarray(efforts, float) - bias - self.friction * qd
        qdd = np.linalg.solve(self._mass(x), free)
        return np.asarray(qdd, float)

    def energy(self, at: State, qd: ArrayLike) -> tuple[float, float]:
        """Return (kinetic, potential) energy in J, including rotors; the potential of mass at the base origin is 0."""
        x = self.configuration(at)
        qd = np.asarray(qd, float)
        V = qd @ self._gain(x).T
        bodies = float(pin.computeKineticEnergy(self._model_with_masses, self._data, x, V))
        rotors = 0.5 * float(qd @ self.rotor @ qd)
        potential = float(pin.computePotentialEnergy(self._model_with_masses, self._data, x))
        return bodies + rotors, potential

    def _inverse_at(self, x: Array, V: Array, Vd: Array, G: Array, qd: Array, qdd: Array) -> Array:
        """Return the joint efforts (n,) for velocities V and accelerations Vd (nv,) of the tree, with gain G."""
        tree_efforts = np.array(pin.rnea(self._model_with_masses, self._data, x, V, Vd))
        return G.T @ tree_efforts + self.rotor @ qdd + self.friction * qd

    # -- internals ---------------------------------------------------------------------------------------

    def _gain(self, x: Array) -> Array:
        """Return G (nv, n): velocities of the tree per rate of each active joint."""
        if not self._has_loops:
            return self._constant_gain
        return self.model.gains(x[None])[0]

    def _mass(self, x: Array) -> Array:
        """Return the mass matrix (n, n) in the active joints, with the rotors."""
        M = self._tree_mass(x)
        G = self._gain(x)
        return G.T @ M @ G + self.rotor

    def _tree_mass(self, x: Array) -> Array:
        """Return the full mass matrix (nv, nv) of the tree; Pinocchio computes its upper half only."""
        M = np.asarray(pin.crba(self._model_with_masses, self._data, x), float)
        upper = self._upper_weights * M.reshape(self._upper_weights.shape)
        return upper + upper.T

    def _newton_euler(self, x: Array, qd: Array, qdd: Array) -> Array:
        """Return the efforts (n,) at rates qd (n,) and accelerations qdd (n,), without rotors and friction."""
        if not self._has_loops:
            G = self._constant_gain
            V = G @ qd
            Vd = G @ qdd
        else:
            Vs, changes, Gs = self.model.motion(x[None], qd[None], qdd[None])
            V = Vs[0]
            Vd = changes[0]
            G = Gs[0]
        tree_efforts = np.array(pin.rnea(self._model_with_masses, self._data, x, V, Vd))
        return G.T @ tree_efforts

    def _determined(self, at: State) -> Array:
        """Return the configuration of a state; raise an error if a passive joint outside the loops moves a mass."""
        if self._undetermined_joint:
            raise MechanismError(
                f"{self.mechanism.name}: no drive and no loop determines the motion of {self._undetermined_joint}, "
                "which moves a mass: drive the joint, make it fixed, or add the missing loop"
            )
        return self.configuration(at)

    @cached_property
    def _home(self) -> Array:
        return self.model.home().x

    @cached_property
    def _constant_gain(self) -> Array:
        """G (nv, n), as returned by `_gain`, of a tree without loops: only couplings move passive joints."""
        if not self._tree.loops.names:
            return np.eye(self._model_with_masses.nv)[:, self._tree.active]
        return self.model.gains(self._home[None])[0]

    @cached_property
    def _followers(self) -> Index:
        """Configuration indices of the passive joints that couplings move."""
        followers = []
        for coupling in self._tree.loops.couplings:
            for place in coupling.places:
                if place not in self._active_places:
                    followers.append(place)
        return np.unique(followers).astype(int)

    @cached_property
    def _follower_gain(self) -> Array:
        """Matrix (followers, n): change of each joint in `_followers` per change of each active joint."""
        column: dict[int, int] = {}
        for coupling in self._tree.loops.couplings:
            column |= zip(coupling.places, coupling.columns, strict=True)
        columns = [column[place] for place in self._followers]
        return self._constant_gain[columns]

    @cached_property
    def _undetermined_joint(self) -> str:
        """A passive joint, as text, that can move a mass at home with all active joints at rest; "" if none can."""
        passive = self._tree.passive
        if not len(passive):
            return ""
        A = self.model.loop_jacobian(self._home)[:, passive]
        # motions of the passive joints alone, in the columns of N
        N = np.eye(len(passive))
        if len(A):
            N = null_space(A, rcond=_RELATIVE_ZERO)
        M = self._tree_mass(self._home)[np.ix_(passive, passive)]
        if np.trace(N.T @ M @ N) <= _NO_INERTIA:
            return ""
        contribution = np.abs(N).sum(axis=1) * np.diag(M)
        column = passive[int(np.argmax(contribution))]
        # the joint of this velocity index is the last one that begins at or before the index
        last = 1
        for number in range(1, self._model_with_masses.njoints):
            if self._model_with_masses.joints[number].idx_v <= column:
                last = number
        return f"joint '{self._model_with_masses.names[last]}'"


class SharedLoops:
    """Inverse dynamics of k models of one mechanism that differ in masses and friction only, tick by tick together.

    The loops are closed, and their gains computed, for all models at once.
    """

    def __init__(self, models: Sequence[Dynamics]) -> None:
        """Store the models.

        Raises:
            MechanismError: see `Dynamics.mass_matrix`.
        """
        self._models = models
        first = models[0]
        if first._undetermined_joint:
            first._determined(first._home)  # raises
        self._continuation = LoopContinuation(first.model) if first._has_loops else None

    def efforts(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Return joint efforts (k, n) for joint values q, rates qd and accelerations qdd (k, n), a row for each model.

        Each row of q must be near that of the last call; see `Dynamics.inverse`.

        Raises:
            AssemblyError: the loops of a row cannot be closed.
        """
        first = self._models[0]
        if self._continuation is None:
            X = np.array([first.configuration(row) for row in q])
            G = np.broadcast_to(first._constant_gain, (len(q), *first._constant_gain.shape))
            V = qd @ first._constant_gain.T
            Vd = qdd @ first._constant_gain.T
        else:
            V, Vd, G = self._continuation.motion(q, qd, qdd)
            X = self._continuation.X
        efforts = []
        for i, model in enumerate(self._models):
            efforts.append(model._inverse_at(X[i], V[i], Vd[i], G[i], qd[i], qdd[i]))
        return np.array(efforts)
