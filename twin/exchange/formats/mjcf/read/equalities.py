"""Read the equality constraints of an MJCF: connects and welds close loops, the others couple joints.

MuJoCo states a coupling relative to the coordinates `ref`, a mechanism by the coordinates themselves:

    MuJoCo       a - a_ref = c0 + c1 (b - b_ref)
    mechanism    a - c1 b = c0 + a_ref - c1 b_ref
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin.core import spatial
from twin.core.errors import UnsupportedError
from twin.core.identifiers import identifier
from twin.exchange.formats.mjcf.read.motors import fixed_tendon
from twin.exchange.formats.mjcf.read.robots import tied_bodies
from twin.exchange.read.imported_robot import Findings
from twin.model.joint import Joint, JointType
from twin.model.mechanism import Coupling

if TYPE_CHECKING:
    import mujoco

_TORQUE_SCALE = 10
"""Place of the attribute torquescale in the numbers of a weld."""


@dataclass
class EqualityReader:
    """Reader of the equality constraints of one compiled model.

    Attributes:
        path: the file.
        model: the compiled model.
        name: function (kind, number) that returns the name of an object.
        bodies, joints: identifiers, by MuJoCo's numbers.
        findings: receives what is left out.
        loop_joints: the joints that close loops, filled by `read`.
        couplings: the couplings of joints, filled by `read`.
    """

    path: Path
    model: mujoco.MjModel
    name: Callable[[str, int], str]
    bodies: Sequence[str]
    joints: Sequence[str]
    findings: Findings

    def __post_init__(self) -> None:
        self.loop_joints: list[Joint] = []
        self.couplings: list[Coupling] = []

    def read(self, robot_bodies: Sequence[int], tree_joints: Sequence[Joint]) -> None:
        """Fill `loop_joints` and `couplings` with those of the robot, whose tree has the joints `tree_joints`.

        Raises:
            UnsupportedError: a mechanism cannot express a constraint.
        """
        used_names = {joint.name for joint in tree_joints}
        for number in range(self.model.neq):
            tied = tied_bodies(self.model, number)
            if tied.issubset(robot_bodies):
                self._add(number, used_names)
            elif not tied.isdisjoint(robot_bodies):
                where = self.name("EQUALITY", number)
                text = f"equality '{where}' is left out, because it acts on a body that is left out."
                self.findings.warn("equality", text, where)

    def _add(self, number: int, used_names: set[str]) -> None:
        """Add an equality constraint, with a name that is not among `used_names`."""
        import mujoco

        model = self.model
        eq = mujoco.mjtEq
        name = self.name("EQUALITY", number)
        kind = eq(int(model.eq_type[number]))
        label = identifier(name)
        while label in used_names:
            label += "_loop"
        used_names.add(label)
        if not model.eq_active0[number]:
            self.findings.warn("inactive", f"equality '{name}' is not active and is left out.", name)
        elif kind in (eq.mjEQ_CONNECT, eq.mjEQ_WELD):
            self.loop_joints.append(self._loop_joint(number, label, kind == eq.mjEQ_WELD))
        elif kind == eq.mjEQ_JOINT:
            self.couplings.append(self._coupling(number, name, label))
        elif kind == eq.mjEQ_TENDON and model.eq_obj2id[number] < 0:
            self.couplings.append(self._tendon_coupling(number, name, label))
        else:
            content = "couples two tendons"
            if kind != eq.mjEQ_TENDON:
                content = f"has the type {kind.name.removeprefix('mjEQ_').lower()}"
            text = f"equality '{name}' {content}, which a mechanism cannot express"
            supported = "supported are connect, weld, joint and tendon (a single tendon)"
            raise UnsupportedError(f"{self.path}: {text}; {supported}")

    def _coupling(self, number: int, name: str, label: str) -> Coupling:
        """Return the coupling of two joints. MuJoCo: a - a_ref = c0 + c1 (b - b_ref) + c2 (b - b_ref)^2 ..."""
        model = self.model
        follower = int(model.eq_obj1id[number])
        leader = int(model.eq_obj2id[number])
        polynomial = model.eq_data[number, :5]
        if leader < 0 or not np.any(polynomial[1:]):
            raise UnsupportedError(
                f"{self.path}: equality '{name}' locks joint '{self.joints[follower]}': remove the joint"
            )
        if np.any(polynomial[2:]):
            raise UnsupportedError(
                f"{self.path}: equality '{name}' is a polynomial of degree > 1; the degree must be 1"
            )
        ratio = float(polynomial[1])
        follower_ref = float(model.qpos0[model.jnt_qposadr[follower]])
        leader_ref = float(model.qpos0[model.jnt_qposadr[leader]])
        total = float(polynomial[0]) + follower_ref - ratio * leader_ref
        return Coupling(label, (self.joints[follower], self.joints[leader]), (1.0, -ratio), total)

    def _tendon_coupling(self, number: int, name: str, label: str) -> Coupling:
        """Return the coupling of a fixed tendon: the sum of coefficient times joint coordinate is constant."""
        tendon = int(self.model.eq_obj1id[number])
        coefficients = fixed_tendon(self.model, tendon)
        if not coefficients:
            raise UnsupportedError(
                f"{self.path}: equality '{name}' constrains a spatial tendon, which is not supported"
            )
        total = float(self.model.tendon_length0[tendon] + self.model.eq_data[number, 0])
        names = tuple(self.joints[joint] for joint in coefficients)
        return Coupling(label, names, tuple(coefficients.values()), total)

    def _loop_joint(self, number: int, label: str, weld: bool) -> Joint:
        """Return the joint for a weld or, if `weld` is False, a connect; between two bodies or two sites."""
        import mujoco

        model = self.model
        data = model.eq_data[number]
        first = int(model.eq_obj1id[number])
        second = int(model.eq_obj2id[number])
        kind: JointType = "spherical"
        if weld and data[_TORQUE_SCALE] != 0.0:  # a weld without torque holds only its anchor, as a connect
            kind = "fixed"
        if int(model.eq_objtype[number]) == int(mujoco.mjtObj.mjOBJ_SITE):
            T_first = _pose(model.site_pos[first], model.site_quat[first])
            T_second = _pose(model.site_pos[second], model.site_quat[second])
            first = int(model.site_bodyid[first])
            second = int(model.site_bodyid[second])
        elif weld:
            # As in MuJoCo's engine_core_constraint.c: the anchor is data[3:6] in body 1 and data[0:3] in body 2
            T_first = _pose(data[3:6], data[6:10])
            T_second = spatial.pose(p=data[0:3])
        else:
            T_first = spatial.pose(p=data[0:3])
            T_second = spatial.pose(p=data[3:6])
        return Joint(label, kind, self.bodies[first], self.bodies[second], T_first, T_second)


def _pose(p: spatial.Array, q_wxyz: spatial.Array) -> spatial.Array:
    return spatial.pose(spatial.matrix_from_quat_wxyz(q_wxyz), p)
