"""The arm in MuJoCo: what the torques really do, by an engine that shares nothing with the controller's model.

It gets placements, inertias, rotors and friction as they are in the file and computes the rest itself. Torques are
held between two ticks of the controller; Runge-Kutta of fourth order, gravity along -z of base.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.errors import MechanismError, TwinError
from twin.core.spatial import Array
from twin.model.mechanism import Inertia

STEP = 0.25e-3
"""Seconds of one integration step: four for each tick at 1 kHz."""

_GRAVITY = (0.0, 0.0, -9.81)


class MujocoPlant:
    """n links in a row, hinged about z of their joint frames.

    Attributes:
        q: (n,) present joints in rad. qd: (n,) rad/s.
    """

    def __init__(
        self,
        placements: ArrayLike,
        links: Sequence[Inertia],
        rotor: ArrayLike,
        friction: ArrayLike,
        step: float = STEP,
        p_last_tip: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Build the model.

        Args:
            placements: (n, 4, 4) joint frame j in joint frame j-1 (the first: in base) with joint j at zero.
            links: in joint frames.
            rotor: (n,) kg m2 at the link.
            friction: (n,) N m s/rad, viscous.
            step: of the integration, s.
            p_last_tip: (3,) m, a point of the last link that `tip` speaks of.

        Raises:
            TwinError: MuJoCo is not installed.
            MechanismError: MuJoCo refuses the links.
        """
        self._mujoco = _engine()
        mujoco = self._mujoco
        spec = mujoco.MjSpec()
        spec.option.timestep = step
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
        spec.option.gravity = list(_GRAVITY)
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)  # it would start again in silence
        spec.compiler.degree = False
        body = spec.worldbody
        parts = zip(np.asarray(placements, float), links, np.asarray(rotor), np.asarray(friction), strict=True)
        for j, (T, link, armature, damping) in enumerate(parts):
            moments, axes = link.principal()
            body = body.add_body(
                name=f"link{j + 1}",
                pos=T[:3, 3],
                quat=spatial.quat_from_matrix_wxyz(T[:3, :3]),
                mass=link.mass,
                ipos=np.asarray(link.p_body_com, float),
                iquat=spatial.quat_from_matrix_wxyz(axes),
                inertia=moments,
                explicitinertial=True,
            )
            joint = body.add_joint(name=f"q{j + 1}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, 1.0])
            joint.armature, joint.damping = _as_field(joint.armature, armature), _as_field(joint.damping, damping)
        body.add_site(name="tip", pos=np.asarray(p_last_tip, float))
        try:
            self._model = spec.compile()
        except ValueError as error:
            raise MechanismError(f"MuJoCo refuses the links: {error}") from error
        self._data = mujoco.MjData(self._model)
        self._step = step

    @property
    def q(self) -> Array:
        """Present joints (n,) in rad."""
        return self._data.qpos.copy()

    @property
    def qd(self) -> Array:
        """Present rates (n,) in rad/s."""
        return self._data.qvel.copy()

    @property
    def tip(self) -> Array:
        """Where the tip is, (3,) in base, m."""
        self._mujoco.mj_kinematics(self._model, self._data)
        return self._data.site("tip").xpos.copy()

    def reset(self, q: ArrayLike, qd: ArrayLike) -> None:
        """Put the arm at q (n,) in rad with qd (n,) in rad/s."""
        self._mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:], self._data.qvel[:] = q, qd

    def advance(self, torque: Array, duration: float) -> None:
        """Move on for a duration in s, a multiple of the step, under constant torques (n,) in N m."""
        self._data.qfrc_applied[:] = torque
        self._mujoco.mj_step(self._model, self._data, round(duration / self._step))

    def forward(self, q: ArrayLike, qd: ArrayLike, torque: ArrayLike) -> Array:
        """Return qdd (n,) in rad/s2 under torques (n,) in N m, friction included."""
        self.reset(q, qd)
        self._data.qfrc_applied[:] = torque
        self._mujoco.mj_forward(self._model, self._data)
        return self._data.qacc.copy()

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Return M (n, n) at q (n,), kg m2, rotors included."""
        self.reset(q, np.zeros(self._model.nv))
        self._mujoco.mj_forward(self._model, self._data)
        out = np.zeros((self._model.nv, self._model.nv))
        for row, unit in zip(out, np.eye(self._model.nv), strict=True):
            self._mujoco.mj_mulM(self._model, self._data, row, unit)
        return out


def _engine() -> Any:
    try:
        import mujoco
    except ImportError:
        raise TwinError(
            "MuJoCo is not installed: pip install mujoco, or let the controller's own equations move the arm "
            "(--plant pinocchio)"
        ) from None
    return mujoco


def _as_field(present: Any, value: float) -> Any:
    """Return a value as MjSpec holds it: newer ones keep polynomials, of which the first term is the linear one."""
    if np.ndim(present) == 0:
        return float(value)
    return [float(value), *([0.0] * (len(present) - 1))]
