"""Plants driven by joint efforts: MuJoCo with an MJCF, or the equations of the controller's model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import MechanismError, TwinError
from twin.core.spatial import Array
from twin.reference.dynamics import Dynamics, State

STEP = 0.25e-3
"""Integration step in s: four steps per tick at 1 kHz."""

_LENGTH_STRIDE = 0.02
"""Largest step of a prismatic joint, in m, from home to the start; the loops are closed after each step."""

_ANGLE_STRIDE = 0.1
"""The same for a revolute joint, in rad."""


_CLOSED = 1e-12
"""Gap in m or rad with which the loops count as closed."""

_MOST_STEPS = 20
"""Maximum number of steps of Gauss-Newton, which doubles the correct digits in each step near a solution."""

_REDUNDANT = 1e-9
"""Relative size of a singular value below which a constraint counts as redundant: loops repeat some of them."""


class Plant(Protocol):
    """Interface of a plant driven by efforts in its n active joints."""

    @property
    def q(self) -> Array:
        """Joint values (n,) in rad or m."""
        ...

    @property
    def qd(self) -> Array:
        """Rates (n,) in rad/s or m/s."""
        ...

    def reset(self, q: ArrayLike, qd: ArrayLike) -> None:
        """Set the state to joint values q (n,) and rates qd (n,)."""
        ...

    def advance(self, efforts: Array, duration: float) -> None:
        """Advance by a duration in s, a multiple of the step, under constant joint efforts (n,) in N m or N."""
        ...


class ModelPlant:
    """A plant that integrates `Dynamics` by the Runge-Kutta method of fourth order.

    This plant uses the same equations as the controller's model; therefore it cannot show errors in these equations.
    """

    def __init__(self, dynamics: Dynamics, step: float = STEP) -> None:
        self._dynamics = dynamics
        self._step = step
        self._state: State | None = None
        self.q = np.zeros(dynamics.n)
        self.qd = np.zeros(dynamics.n)

    def reset(self, q: ArrayLike, qd: ArrayLike) -> None:
        """Set the state to joint values q (n,) and rates qd (n,)."""
        self.q = np.array(q, float)
        self.qd = np.array(qd, float)
        self._state = None

    def advance(self, efforts: Array, duration: float) -> None:
        """Advance by a duration in s, a multiple of the step, under constant joint efforts (n,) in N m or N."""

        def acceleration(q: Array, v: Array) -> Array:
            # The last state is a start for closing the loops at the next one.
            self._state = self._dynamics.near(q, self._state)
            return self._dynamics.forward(self._state, v, efforts)

        # The velocities of the four stages are inserted, so that each stage needs only its acceleration.
        h = self._step
        for _ in range(round(duration / h)):
            q = self.q
            v = self.qd
            a1 = acceleration(q, v)
            a2 = acceleration(q + h / 2 * v, v + h / 2 * a1)
            a3 = acceleration(q + h / 2 * v + h * h / 4 * a1, v + h / 2 * a2)
            a4 = acceleration(q + h * v + h * h / 2 * a2, v + h * a3)
            self.q = q + h * v + h * h / 6 * (a1 + a2 + a3)
            self.qd = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


class MujocoPlant:
    """A mechanism in MuJoCo, an engine that is independent of the controller's model.

    Actuators, joint limits and contacts of the MJCF are disabled; loops are closed by the constraints of the MJCF, and
    gravity is as in the MJCF. Efforts are constant between two ticks of the controller. The integrator is the
    Runge-Kutta method of fourth order.

    Attributes:
        model, data: MuJoCo's model and data.
    """

    def __init__(
        self, mjcf: str, joints: Sequence[str], rotor: ArrayLike, friction: ArrayLike, step: float = STEP
    ) -> None:
        """Compile the model.

        Args:
            mjcf: text of an MJCF without meshes, with a keyframe named home.
            joints: names of the n active joints, in the order of q.
            rotor: (n,) rotor inertia at the joints in kg m2 or kg, added to the inertia in the MJCF.
            friction: (n,) viscous friction, N m s/rad or N s/m.
            step: integration step in s.

        Raises:
            TwinError: MuJoCo is not installed.
            MechanismError: MuJoCo rejects the MJCF.
        """
        self._mujoco = mujoco = _engine()
        try:
            self.model = model = mujoco.MjModel.from_xml_string(mjcf)
        except ValueError as error:
            raise MechanismError(f"MuJoCo rejects the masses or joints: {error}") from error
        model.opt.timestep = step
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
        # `_close` reads the Jacobian of the constraints as a dense matrix.
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        bits = mujoco.mjtDisableBit
        # By default, MuJoCo resets a diverging simulation without raising an error.
        disabled = bits.mjDSBL_AUTORESET | bits.mjDSBL_ACTUATION | bits.mjDSBL_LIMIT | bits.mjDSBL_CONTACT
        # Separate islands of constraints take time to find, and the loops of a robot are too few to gain by them.
        disabled |= bits.mjDSBL_ISLAND
        model.opt.disableflags |= int(disabled)
        ids = [model.joint(name).id for name in joints]
        self._places = model.jnt_qposadr[ids]
        self._rates = model.jnt_dofadr[ids]
        # the rates of the passive joints, which follow from the loops
        self._free = np.setdiff1d(np.arange(model.nv), self._rates)
        model.dof_armature[self._rates] += np.asarray(rotor, float)
        damping = model.dof_damping
        if damping.ndim > 1:  # newer versions have a polynomial, whose first coefficient is the linear one
            damping = damping[:, 0]
        damping[self._rates] = friction
        self._angles = model.jnt_type[ids] == mujoco.mjtJoint.mjJNT_HINGE
        self.data = mujoco.MjData(model)
        mujoco.mj_setConst(model, self.data)
        self._step = step

    @property
    def q(self) -> Array:
        """Current joint values (n,) in rad or m."""
        return self.data.qpos[self._places]

    @property
    def qd(self) -> Array:
        """Current rates (n,) in rad/s or m/s."""
        return self.data.qvel[self._rates]

    def reset(self, q: ArrayLike, qd: ArrayLike) -> None:
        """Set the state to joint values q (n,) and rates qd (n,); loops are closed in steps from home to q.

        Raises:
            MechanismError: the loops cannot be closed at q.
        """
        data = self.data
        q = np.asarray(q, float)
        qd = np.asarray(qd, float)
        self._mujoco.mj_resetDataKeyframe(self.model, data, self.model.key("home").id)
        if not self.model.neq:
            data.qpos[self._places] = q
            data.qvel[self._rates] = qd
            return
        home = self.q.copy()
        largest_strides = np.where(self._angles, _ANGLE_STRIDE, _LENGTH_STRIDE)
        strides = np.abs(q - home) / largest_strides
        # at least one step: the loops are closed also if q is the home posture
        steps = max(1, int(np.ceil(np.max(strides))))
        J = np.zeros((0, self.model.nv))
        for share in np.linspace(0, 1, steps + 1)[1:]:
            data.qpos[self._places] = home + share * (q - home)
            J = self._close()
        data.qvel[self._rates] = qd
        # the rates of the free joints that keep the constraints, J qvel = 0
        data.qvel[self._free] = -np.linalg.pinv(J[:, self._free], rcond=_REDUNDANT) @ (J[:, self._rates] @ qd)

    def _close(self) -> Array:
        """Close the loops by Gauss-Newton, at fixed active joints; return the Jacobian of MuJoCo's constraints."""
        mujoco = self._mujoco
        model = self.model
        data = self.data
        gap = np.inf
        for _ in range(_MOST_STEPS):
            mujoco.mj_fwdPosition(model, data)
            # copies, because MuJoCo overwrites its arrays in the next call
            residual = data.efc_pos.copy()
            J = data.efc_J.reshape(-1, model.nv).copy()
            gap = np.abs(residual).max()
            if gap < _CLOSED:
                return J
            step = np.zeros(model.nv)
            step[self._free] = -np.linalg.pinv(J[:, self._free], rcond=_REDUNDANT) @ residual
            mujoco.mj_integratePos(model, data.qpos, step, 1.0)
        raise MechanismError(f"the loops of the plant do not close at the start: {gap:.1e} m or rad remain")

    def advance(self, efforts: Array, duration: float) -> None:
        """Advance by a duration in s, a multiple of the step, under constant joint efforts (n,) in N m or N."""
        self.data.qfrc_applied[self._rates] = efforts
        steps = round(duration / self._step)
        self._mujoco.mj_step(self.model, self.data, steps)


def _engine() -> Any:
    """Return the module `mujoco`, which is imported only when a plant needs it.

    Raises:
        TwinError: it is not installed.
    """
    try:
        import mujoco
    except ImportError:
        raise TwinError(
            "MuJoCo is not installed: pip install mujoco, or use --plant pinocchio, which integrates the "
            "controller's equations"
        ) from None
    return mujoco
