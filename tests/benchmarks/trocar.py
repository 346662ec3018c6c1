"""Tip and trocar of the PA-10 from random starts: time per success.

Peers but scipy and Drake have no trocar task: they get the full pose of a solution, harder on redundancy, easier on the
side. A success keeps the joint limits and misses by less than 1e-6 m and rad.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from race import Contender, Effort, Table, installed, race

from twin.formula.evaluator import Evaluator
from twin.kinematics import Tip, Trocar, compile_formula, solve
from twin.kinematics.tasks import residual
from twin.robots import load_formula

sys.path.append(str(Path(__file__).parents[1]))
from made.srs import SrsArm

COUNT, STEPS, TOLERANCE = 40, 100, 1e-6
HALF = np.radians([177, 94, 174, 137, 255, 165, 255])
LIMITS = np.stack([-HALF, HALF], axis=1)
AXES, LENGTHS = "zyzyzyz", (0, 0, 0.45, 0, 0.48, 0, 0.40)

KIN = compile_formula(load_formula("pa10"))
RNG = np.random.default_rng(0)
TS = KIN.forward_many(RNG.uniform(-HALF, HALF, (COUNT, 7)))
PROBLEMS = [(T[:3, 3], T[:3, 3] - d * T[:3, 2]) for T, d in zip(TS, RNG.uniform(0.05, 0.35, COUNT), strict=True)]
STARTS = RNG.uniform(-HALF, HALF, (COUNT, 7))


def good(q: np.ndarray, T: np.ndarray) -> bool:
    """Return whether joints keep the limits and take the pose."""
    q = np.where(np.abs(q) > HALF, np.angle(np.exp(1j * q)), q)
    return bool((np.abs(q) <= HALF).all() and np.abs(KIN.forward(q) - T).max() < TOLERANCE)


def closed() -> Callable[[], int]:
    """The closed form at swivel 0, at another where that breaks a limit."""
    arm = SrsArm(0.45, 0.48, 0.40, LIMITS[:6])

    def run() -> int:
        return sum(arm.solve(tip, trocar).margin > 0 for tip, trocar in PROBLEMS)

    return run


def general() -> Callable[[], int]:
    """Levenberg-Marquardt of this project on tip and trocar, multi-start."""

    def run() -> int:
        found = (
            solve(KIN, Tip(a) + Trocar(b, axis=(0, 0, 1)), limits=LIMITS, any_branch=True, rng=i)
            for i, (a, b) in enumerate(PROBLEMS)
        )
        return sum(f.residual < 1e-9 for f in found)

    return run


def roboticstoolbox() -> Callable[[], int]:
    """Robotics Toolbox, ik_LM in C++ (Chan), with its own restarts."""
    from roboticstoolbox import ET

    ets = None
    for axis, length, half in zip(AXES, LENGTHS, HALF, strict=True):
        turn = getattr(ET, f"R{axis}")(qlim=[-half, half])
        ets = turn if ets is None else ets * turn
        if length:
            ets = ets * ET.tz(length)

    def run() -> int:
        return sum(
            good(ets.ik_LM(T, q0, tol=1e-14, joint_limits=True, method="chan")[0], T)
            for T, q0 in zip(TS, STARTS, strict=True)
        )

    return run


def pink() -> Callable[[], int]:
    """Pink: a frame task, integrated until it stands."""
    import pink as library
    import pinocchio as pin

    model, parent = pin.Model(), 0
    for j, (axis, half) in enumerate(zip(AXES, HALF, strict=True)):
        placement = pin.SE3(np.eye(3), np.array([0, 0, LENGTHS[j - 1] if j else 0.0]))
        kind = {"z": pin.JointModelRZ, "y": pin.JointModelRY}[axis]()
        limit = np.array([half])
        parent = model.addJoint(parent, kind, placement, f"q{j + 1}", 1e3 * limit, 1e3 * limit, -limit, limit)
    tip = pin.SE3(np.eye(3), np.array([0, 0, LENGTHS[-1]]))
    model.addFrame(pin.Frame("tip", parent, 0, tip, pin.FrameType.OP_FRAME))
    data = model.createData()
    task = library.tasks.FrameTask("tip", position_cost=1.0, orientation_cost=1.0)

    def solve_ik(state: Any) -> Any:
        return library.solve_ik(state, [task], 1.0, solver="daqp", safety_break=False)

    return _integrated(library, task, pin.SE3, lambda q0: library.Configuration(model, data, q0), solve_ik)


def mink() -> Callable[[], int]:
    """Mink: the same on MuJoCo."""
    import mink as library
    import mujoco

    inner, close = "", ""
    for j, (axis, half) in enumerate(zip(AXES, HALF, strict=True)):
        lift = LENGTHS[j - 1] if j else 0.0
        vector = "0 0 1" if axis == "z" else "0 1 0"
        joint = f'<joint name="q{j + 1}" axis="{vector}" range="{-half} {half}"/>'
        inner += f'<body pos="0 0 {lift}">{joint}<geom size=".01" mass="1"/>'
        close += "</body>"
    inner += f'<site name="tip" pos="0 0 {LENGTHS[-1]}"/>'
    text = f'<mujoco><compiler angle="radian" autolimits="true"/><worldbody>{inner}{close}</worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(text)
    task = library.FrameTask("tip", "site", position_cost=1.0, orientation_cost=1.0)

    def solve_ik(state: Any) -> Any:
        return library.solve_ik(state, [task], 1.0, "daqp", limits=[library.ConfigurationLimit(model)])

    return _integrated(library, task, library.SE3.from_matrix, lambda q0: library.Configuration(model, q0), solve_ik)


def _integrated(library: Any, task: Any, pose: Any, start: Callable, solve_ik: Callable) -> Callable[[], int]:
    """Pink and mink alike: velocities are integrated until the task stands."""

    def run() -> int:
        done = 0
        for T, q0 in zip(TS, STARTS, strict=True):
            state = start(q0)
            task.set_target(pose(T))
            for _ in range(STEPS):
                try:
                    v = solve_ik(state)
                except library.exceptions.NoSolutionFound:
                    break
                state.integrate_inplace(v, 1.0)
                if np.linalg.norm(task.compute_error(state)) < 1e-9:
                    break
            done += good(state.q, T)
        return done

    return run


def pydrake() -> Callable[[], int]:
    """Drake: SNOPT on tip and trocar themselves, as bounds on positions seen from the world and from the tool."""
    from pydrake.math import RigidTransform
    from pydrake.multibody.inverse_kinematics import InverseKinematics
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, SpatialInertia, WeldJoint
    from pydrake.solvers import SnoptSolver, SolverOptions

    plant = MultibodyPlant(0.0)
    parent = plant.world_frame()
    for j, (axis, half) in enumerate(zip(AXES, HALF, strict=True)):
        lift = RigidTransform(np.array([0, 0, LENGTHS[j - 1] if j else 0.0]))
        frame = plant.AddFrame(FixedOffsetFrame(f"f{j + 1}", parent, lift))
        body = plant.AddRigidBody(f"link{j + 1}", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
        direction = np.array([0.0, 0, 1] if axis == "z" else [0.0, 1, 0])
        plant.AddJoint(RevoluteJoint(f"q{j + 1}", frame, body.body_frame(), direction, -half, half))
        parent = body.body_frame()
    tool = plant.AddRigidBody("tool", SpatialInertia.SolidSphereWithMass(1.0, 0.1)).body_frame()
    plant.AddJoint(WeldJoint("tip", parent, tool, RigidTransform(np.array([0, 0, LENGTHS[-1]]))))
    plant.Finalize()
    world, solver, options = plant.world_frame(), SnoptSolver(), SolverOptions()
    for name in ("Major feasibility tolerance", "Major optimality tolerance"):
        options.SetOption(solver.solver_id(), name, 1e-9)

    def run() -> int:
        done = 0
        for (tip, trocar), T, q0 in zip(PROBLEMS, TS, STARTS, strict=True):
            problem = InverseKinematics(plant, with_joint_limits=True)
            problem.AddPositionConstraint(tool, np.zeros(3), world, tip, tip)
            beyond = np.array([0, 0, -np.linalg.norm(trocar - tip)])
            problem.AddPositionConstraint(world, trocar, tool, beyond, beyond)
            found = solver.Solve(problem.prog(), q0, options)
            q = found.GetSolution(problem.q())
            reached = KIN.forward(q)
            aside = np.abs(reached[:3, 3] - T[:3, 3]).max() + np.abs(reached[:3, 2] - T[:3, 2]).max()
            done += bool(found.is_success() and aside < TOLERANCE and (np.abs(q) <= HALF + 1e-9).all())
        return done

    return run


def scipy_exact() -> Callable[[], int]:
    """Levenberg-Marquardt of scipy, exact Jacobian, one start."""
    from scipy.optimize import least_squares

    # What its user would compile; padded, since 'lm' wants as many rows as unknowns.
    z = ca.SX.sym("z", 13)
    T, q = KIN.program.around(ca.SX.zeros(7), z[:7])
    rows = ca.vertcat(
        residual("tip", (0, 1, 2), T, q, ca.vertcat(z[7:10], ca.SX.zeros(3))),
        residual("trocar", (0, 1, 2), T, q, ca.vertcat(z[10:13], 0, 0, 1, ca.SX.zeros(3))),
        0,
    )
    value, derivative = Evaluator("r", z, rows), Evaluator("J", z, ca.jacobian(rows, z[:7]), (7, 7))

    def run() -> int:
        done = 0
        for (tip, trocar), q0 in zip(PROBLEMS, STARTS, strict=True):
            target = np.concatenate([tip, trocar])
            found = least_squares(
                lambda q, target=target: value.one(np.concatenate([q, target])),
                q0,
                lambda q, target=target: derivative.one(np.concatenate([q, target])),
                method="lm",
                xtol=1e-14,
                ftol=1e-14,
            )
            done += _within(found)
        return done

    return run


def scipy_plain() -> Callable[[], int]:
    """What is written down first for scipy: a residual in numpy, differences for its derivative, one start."""
    from scipy.optimize import least_squares

    def miss(q: np.ndarray, tip: np.ndarray, trocar: np.ndarray) -> np.ndarray:
        T = KIN.forward(q)
        w = trocar - T[:3, 3]
        return np.concatenate([T[:3, 3] - tip, w + np.linalg.norm(w) * T[:3, 2], [0.0]])

    def run() -> int:
        done = 0
        for problem, q0 in zip(PROBLEMS, STARTS, strict=True):
            done += _within(least_squares(miss, q0, args=problem, method="lm", xtol=1e-14, ftol=1e-14))
        return done

    return run


def _within(found: Any) -> bool:
    q = np.angle(np.exp(1j * found.x))  # a turn more or less is the same posture
    return bool(np.linalg.norm(found.fun) < 1e-9 and (np.abs(q) <= HALF).all())


CONTENDERS = (
    ("twin: closed form, with its scan and limits", "numpy", closed, None),
    ("twin: general solver, multi-start", "numpy", general, None),
    ("Robotics Toolbox, ik_LM in C++ (Chan)", "roboticstoolbox", roboticstoolbox, 4.0),
    ("scipy least_squares('lm'), exact Jacobian", "scipy", scipy_exact, 40.0),
    ("scipy least_squares('lm'), plain", "scipy", scipy_plain, None),
    ("pink and daqp", "pink", pink, None),
    ("mink and daqp", "mink", mink, None),
    ("Drake IK, SNOPT at 1e-9", "pydrake", pydrake, None),
)
"""Bars are those that were set for the closed form."""


def topic(effort: Effort) -> list[Table]:
    """Race all that are installed; in the short form only those that come with the development packages."""
    table = Table("trocar", f"Tip and trocar of the PA-10, {COUNT} random starts: time per success within the limits")
    contenders = []
    for name, module, make, bar in CONTENDERS:
        if effort.short and (make is scipy_plain or module in ("pink", "mink", "pydrake")):
            continue
        if installed(table, module, name):
            run = make()
            contenders.append(Contender(name, run, COUNT, None, f"{run()} of {COUNT}", bar, counted=True))
    table.notes.append("Robotics Toolbox, pink and mink are given the full pose of a solution, having no trocar task.")
    return [race(table, contenders, effort)]
