"""The closed loops of SILS as users of other libraries would solve them; each contender gets the same mechanism.

Every model takes the joint frames of the mechanism as its own, so that joint coordinates mean the same everywhere:
`common` is {passive joint: angle, or quaternion w x y z of a ball}. Planar loops are closed at a point, which is all
they need. All but Drake stop when no loop is open by more than `CLOSED`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from twin.core import spatial
from twin.kinematics.closed_loops import LoopSolver
from twin.kinematics.closed_loops.equations import STATE_SIZES
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel

CLOSED, STEPS, DAMPING = 1e-11, 30, 1e-13
Common = dict[str, Any]


class Ours:
    """The states of `twin.kinematics.closed_loops` as `common`, and back."""

    def __init__(self, solver: LoopSolver) -> None:
        self.solver, self.at, start = solver, {}, 0
        for p in solver.equations.passive:
            n = STATE_SIZES[p.joint.type]
            self.at[p.name] = slice(start, start + n)
            start += n

    def common(self, state: np.ndarray) -> Common:
        return {n: state[s] if s.stop - s.start > 1 else float(state[s][0]) for n, s in self.at.items()}

    def vector(self, common: Common) -> np.ndarray:
        return np.concatenate([np.atleast_1d(common[n]) for n in self.at])


class Judge:
    """Pinocchio's model of the mechanism (`twin.reference`): how far are the loops open, and where is the tool?"""

    def __init__(self, mechanism: Mechanism) -> None:
        self.model = ReferenceModel(mechanism)
        self.tree = self.model.tree
        self.names = [j.name for j in mechanism.active]

    def configuration(self, q: np.ndarray, common: Common) -> np.ndarray:
        x = np.zeros(self.tree.model.nq)
        for name, value in [*zip(self.names, q, strict=True), *common.items()]:
            at = self.tree.model.joints[self.tree.joint_id[name]].idx_q
            x[at : at + np.size(value)] = np.roll(value, -1) if np.size(value) == 4 else value
        return x

    def __call__(self, q: np.ndarray, common: Common) -> tuple[float, np.ndarray]:
        """Return the largest gap in m and T_base_tool (4, 4)."""
        X = self.configuration(q, common)[None]
        poses = self.tree.update(X)[0]
        return float(self.tree.loops.gaps(X, poses)[0, :, 0].max()), self.tree.tool(poses)[0]


class Pinocchio:
    """Point constraints of Pinocchio, Gauss-Newton in Python; of planar loops, rows that say nothing are left out."""

    def __init__(self, judge: Judge) -> None:
        import pinocchio as pin

        self.pin, self.judge, self.model = pin, judge, judge.tree.model
        self.data = self.model.createData()
        self.constraints, self.datas = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
        for j in judge.model.mechanism.loops:
            ends: list[Any] = []
            for body, T in ((j.parent, j.T_parent_joint), (j.child, j.T_child_joint)):
                number, T_joint_body = judge.tree.body(body)
                ends += [number, pin.SE3(T_joint_body @ T)]
            constraint = pin.ConstraintModel(pin.PointAnchorConstraintModel(self.model, *ends))
            self.constraints.append(constraint)
            self.datas.append(constraint.createData())
        self.active, self.passive = judge.tree.active, judge.tree.passive
        at = [self.model.joints[judge.tree.joint_id[n]].idx_q for n in judge.names]
        self.at, self.rows = np.array(at), np.arange(3 * len(self.constraints))
        x = pin.integrate(self.model, pin.neutral(self.model), np.linspace(0.1, 0.9, self.model.nv))
        slopes = self._residual(x)[1]
        self.rows = np.flatnonzero(np.abs(slopes).max(axis=1) > 1e-9)

    def _residual(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self.pin.computeJointJacobians(self.model, self.data, x)
        for constraint, data in zip(self.constraints, self.datas, strict=True):
            constraint.calc(self.model, self.data, data)
        r = np.concatenate([d.extract().constraint_position_error for d in self.datas])
        J = self.pin.getConstraintsJacobian(self.model, self.data, self.constraints, self.datas)
        return r[self.rows], J[self.rows[:, None], self.passive]

    def start(self, q: np.ndarray, common: Common) -> np.ndarray:
        return self.judge.configuration(q, common)

    def solve(self, q: np.ndarray, x: np.ndarray) -> np.ndarray:
        x = x.copy()
        x[self.at] = q
        v = np.zeros(self.model.nv)
        for _ in range(STEPS):
            r, J = self._residual(x)
            if np.abs(r).max() < CLOSED:
                break
            v[self.passive] = _step(J, r)
            x = self.pin.integrate(self.model, x, v)
        return x

    def common(self, x: np.ndarray) -> Common:
        out = {}
        for j in self.judge.model.mechanism.tree:
            if not j.active:
                at = self.model.joints[self.judge.tree.joint_id[j.name]].idx_q
                out[j.name] = np.roll(x[at : at + 4], 1) if j.type == "spherical" else float(x[at])
        return out


def _step(J: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Return the step of Gauss and Newton: the cheapest way numpy has."""
    if J.shape[0] == J.shape[1]:
        return np.linalg.solve(J, -r)
    A = J.T @ J
    A.flat[:: len(A) + 1] += DAMPING
    return np.linalg.solve(A, -(J.T @ r))


class MuJoCo:
    """Equality constraints `connect`; kinematics and efc_J by MuJoCo, Gauss-Newton in Python."""

    def __init__(self, mechanism: Mechanism) -> None:
        import mujoco

        self.library, children, self.sites = mujoco, {}, {}
        for j in mechanism.tree:
            children.setdefault(j.parent, []).append(j)
        own = {mechanism.base: np.eye(4)} | {j.child: j.T_child_joint for j in mechanism.tree}  # the body's frame here
        for j in mechanism.loops:
            for end, body, T in (("a", j.parent, j.T_parent_joint), ("b", j.child, j.T_child_joint)):
                p = (spatial.inverse(own[body]) @ T)[:3, 3]
                self.sites[body] = self.sites.get(body, "") + f'<site name="{j.name}_{end}" pos="{_text(p)}"/>'

        def body(name: str) -> str:
            text = self.sites.get(name, "")
            for j in children.get(name, []):
                T = spatial.inverse(own[name]) @ j.T_parent_joint
                kind = {"revolute": "hinge", "prismatic": "slide", "spherical": "ball"}[j.type]
                axis = "" if kind == "ball" else ' axis="0 0 1"'
                quat = _text(spatial.quat_from_matrix_wxyz(T[:3, :3]))
                text += (
                    f'<body name="{j.child}" pos="{_text(T[:3, 3])}" quat="{quat}">'
                    f'<joint name="{j.name}" type="{kind}"{axis}/>'
                    f'<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{body(j.child)}</body>'
                )
            return text

        ties = "".join(f'<connect site1="{j.name}_a" site2="{j.name}_b"/>' for j in mechanism.loops)
        text = (
            '<mujoco><option jacobian="dense"/><compiler angle="radian"/>'
            f"<worldbody>{body(mechanism.base)}</worldbody><equality>{ties}</equality></mujoco>"
        )
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)
        joints = {j.name: self.model.joint(j.name) for j in mechanism.tree}
        self.at = {n: slice(int(j.qposadr[0]), int(j.qposadr[0]) + len(j.qpos0)) for n, j in joints.items()}
        self.active = np.array([self.at[j.name].start for j in mechanism.active])
        driven = [int(joints[j.name].dofadr[0]) for j in mechanism.active]
        self.names = [j.name for j in mechanism.active]
        self.passive = np.setdiff1d(np.arange(self.model.nv), driven)

    def start(self, q: np.ndarray, common: Common) -> np.ndarray:
        x = np.zeros(self.model.nq)
        for name, value in [*zip(self.names, q, strict=True), *common.items()]:
            x[self.at[name]] = value
        return x

    def solve(self, q: np.ndarray, x: np.ndarray) -> np.ndarray:
        m, d, library = self.model, self.data, self.library
        d.qpos[:] = x
        d.qpos[self.active] = q
        v = np.zeros(m.nv)
        for _ in range(STEPS):
            library.mj_kinematics(m, d)
            library.mj_comPos(m, d)
            library.mj_makeConstraint(m, d)
            r = d.efc_pos
            if np.abs(r).max() < CLOSED:
                break
            v[self.passive] = _step(d.efc_J.reshape(len(r), m.nv)[:, self.passive], r)
            library.mj_integratePos(m, d.qpos, v, 1.0)
        return d.qpos.copy()

    def common(self, x: np.ndarray) -> Common:
        passive = {n: s for n, s in self.at.items() if n not in self.names}
        return {n: x[s].copy() if s.stop - s.start > 1 else float(x[s][0]) for n, s in passive.items()}


def _text(values: np.ndarray) -> str:
    return " ".join(repr(float(v)) for v in values)


class Drake:
    """InverseKinematics of Drake, positions of the loops as constraints, by SNOPT; made once, bounds moved."""

    def __init__(self, mechanism: Mechanism, tolerance: float | None = None) -> None:
        from pydrake.math import RigidTransform
        from pydrake.multibody.inverse_kinematics import InverseKinematics
        from pydrake.multibody.plant import MultibodyPlant
        from pydrake.multibody.tree import BallRpyJoint, FixedOffsetFrame, PrismaticJoint, RevoluteJoint, SpatialInertia
        from pydrake.solvers import SnoptSolver, SolverOptions

        self.plant = plant = MultibodyPlant(0.0)
        inertia = SpatialInertia.SolidSphereWithMass(1.0, 0.1)
        bodies = {mechanism.base: plant.world_body()}
        bodies |= {j.child: plant.AddRigidBody(j.child, inertia) for j in mechanism.tree}

        def frame(name: str, body: str, T: np.ndarray) -> Any:
            return plant.AddFrame(FixedOffsetFrame(name, bodies[body].body_frame(), RigidTransform(T)))

        z, joints = np.array([0.0, 0, 1]), {}
        for j in mechanism.tree:
            ends = [frame(f"{j.name}_a", j.parent, j.T_parent_joint), frame(f"{j.name}_b", j.child, j.T_child_joint)]
            kind = {"revolute": RevoluteJoint, "prismatic": PrismaticJoint, "spherical": BallRpyJoint}[j.type]
            joints[j.name] = plant.AddJoint(kind(j.name, *ends, *([] if j.type == "spherical" else [z])))
        loops = [
            (frame(f"{j.name}_a", j.parent, j.T_parent_joint), frame(f"{j.name}_b", j.child, j.T_child_joint), j)
            for j in mechanism.loops
        ]
        plant.Finalize()
        self.kinematics = InverseKinematics(plant, with_joint_limits=False)
        for a, b, j in loops:
            axial = 1.0 if j.type == "revolute" else 0.0  # a planar loop cannot open along its pin
            self.kinematics.AddPositionConstraint(b, np.zeros(3), a, -axial * z, axial * z)
        self.at = {n: slice(j.position_start(), j.position_start() + j.num_positions()) for n, j in joints.items()}
        self.names = [j.name for j in mechanism.active]
        self.active = np.array([self.at[n].start for n in self.names])
        program = self.kinematics.prog()
        zeros = np.zeros(len(self.active))
        self.driven = program.AddBoundingBoxConstraint(zeros, zeros, self.kinematics.q()[self.active]).evaluator()
        self.solver, self.options = SnoptSolver(), SolverOptions()
        if tolerance is not None:
            for name in ("Major feasibility tolerance", "Major optimality tolerance", "Minor feasibility tolerance"):
                self.options.SetOption(self.solver.solver_id(), name, tolerance)

    def start(self, q: np.ndarray, common: Common) -> np.ndarray:
        from pydrake.math import RollPitchYaw
        from pydrake.math import RotationMatrix as Matrix

        x = np.zeros(self.plant.num_positions())
        for name, value in [*zip(self.names, q, strict=True), *common.items()]:
            ball = np.size(value) == 4
            x[self.at[name]] = RollPitchYaw(Matrix(_rotation(value))).vector() if ball else value
        return x

    def solve(self, q: np.ndarray, x: np.ndarray) -> np.ndarray:
        x = x.copy()
        x[self.active] = q
        self.driven.UpdateLowerBound(q)
        self.driven.UpdateUpperBound(q)
        found = self.solver.Solve(self.kinematics.prog(), x, self.options)
        return found.GetSolution(self.kinematics.q())

    def common(self, x: np.ndarray) -> Common:
        from pydrake.math import RollPitchYaw

        out: Common = {}
        for n, s in self.at.items():
            if n not in self.names:
                ball = s.stop - s.start == 3
                out[n] = RollPitchYaw(x[s]).ToQuaternion().wxyz() if ball else float(x[s][0])
        return out


def _rotation(wxyz: np.ndarray) -> np.ndarray:
    w, v = wxyz[0], wxyz[1:]
    return (w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * spatial.hat(v)


class Casadi:
    """The equations of `closed_loops` in CasADi itself: rootfinder `fast_newton`, called through its buffer."""

    def __init__(self, solver: LoopSolver) -> None:
        self.ours, e = Ours(solver), solver.equations
        rows = [r for b in solver.blocks for r in b.rows]
        stepped = ca.vertcat(*[p.stepped(p.step) for p in e.passive])
        r = ca.substitute(e.residual[rows], e.states, stepped)
        problem = {"x": e.steps, "p": ca.vertcat(e.q, e.states), "g": r}
        options = {"error_on_fail": False, "abstol": CLOSED, "abstolStep": CLOSED, "max_iter": STEPS}
        finder = ca.rootfinder("finder", "fast_newton", problem, options)
        n, m = e.q.numel(), e.states.numel()
        moved = ca.Function("moved", [e.states, e.steps], [stepped])
        z = ca.MX.sym("z", n + m)
        function = ca.Function("f", [z], [moved(z[n:], finder(x0=ca.DM.zeros(e.steps.numel()), p=z)["x"])])
        self.x, self.y, self.n = np.zeros(n + m), np.zeros(m), n
        self.buffer, self.trigger = function.buffer()
        self.buffer.set_arg(0, memoryview(self.x))
        self.buffer.set_res(0, memoryview(self.y))

    def start(self, q: np.ndarray, common: Common) -> np.ndarray:
        return self.ours.vector(common)

    def solve(self, q: np.ndarray, x: np.ndarray) -> np.ndarray:
        self.x[: self.n], self.x[self.n :] = q, x
        self.trigger()
        return self.y.copy()

    def common(self, x: np.ndarray) -> Common:
        return self.ours.common(x)


class Scipy:
    """`scipy.optimize.root` (hybr) with residual and exact Jacobian compiled by CasADi."""

    def __init__(self, solver: LoopSolver) -> None:
        from scipy.optimize import root

        from twin.formula.evaluator import Evaluator

        self.root, self.ours, e = root, Ours(solver), solver.equations
        rows = [r for b in solver.blocks for r in b.rows]
        stepped = ca.vertcat(*[p.stepped(p.step) for p in e.passive])
        z = ca.SX.sym("z", e.q.numel() + e.states.numel() + e.steps.numel())
        r = ca.substitute(e.residual[rows], e.states, stepped)
        parts = ca.vertcat(e.q, e.states, e.steps)
        J = ca.densify(ca.jacobian(r, e.steps))
        r, J, moved = ca.substitute([r, J, stepped], [parts], [z])
        n = e.steps.numel()
        self.residual, self.moved = Evaluator("r", z, r), Evaluator("moved", z, moved)
        self.slopes, self.zero = Evaluator("J", z, J, (n, n)), np.zeros(n)

    start, common = Casadi.start, Casadi.common

    def solve(self, q: np.ndarray, x: np.ndarray) -> np.ndarray:
        given = np.concatenate([q, x])
        at: Callable = lambda step: np.concatenate([given, step])  # noqa: E731
        found = self.root(
            lambda s: self.residual.one(at(s)), self.zero, jac=lambda s: self.slopes.one(at(s)), tol=1e-12
        )
        return self.moved.one(at(found.x))
