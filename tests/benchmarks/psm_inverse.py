"""Inverse kinematics of the da Vinci's instrument arm: the closed form against iterative solvers by others."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from race import Contender, Effort, Fact, Table, installed, race

import twin

ROWS = (
    (np.pi / 2, 0.0, 0.0, np.pi / 2),
    (-np.pi / 2, 0.0, 0.0, -np.pi / 2),
    (np.pi / 2, 0.0, -0.4318, 0.0),
    (0.0, 0.0, 0.4162, 0.0),
    (-np.pi / 2, 0.0, 0.0, -np.pi / 2),
    (-np.pi / 2, 0.0091, 0.0, -np.pi / 2),
)
"""Modified Denavit-Hartenberg rows (alpha, a, d, theta) of dVRK, in rad and m; joint 3 is prismatic."""
LOW = np.array([-1.588, -0.925, 0.06, -3.1, -1.396, -1.396])
HIGH = np.array([1.588, 0.925, 0.24, 3.1, 1.396, 1.396])
"""Joint values from which poses are drawn: limits, at least 44 mm past the RCM, within one turn of the roll."""
NEAR = 0.1
"""Largest distance of the start of an iterative solver from the solution, as a fraction of the range of a joint."""
TOLERANCE = 1e-9
"""Largest error of a pose, m and 1, at which an answer counts."""


def topic(effort: Effort) -> list[Table]:
    """Run the race."""
    title = "Inverse kinematics of the da Vinci's instrument arm (PSM), one pose a call"
    table = Table("psm", title, judge="largest error of a pose, m and 1", limit=TOLERANCE)
    count = effort.of(200, 40)
    rng = np.random.default_rng(5)
    kin = twin.load("davinci_psm").kinematics()
    q = np.column_stack([rng.uniform(LOW, HIGH, (count, 6)), np.zeros(count)])
    starts = np.clip(q[:, :6] + rng.uniform(-NEAR, NEAR, (count, 6)) * (HIGH - LOW), LOW, HIGH)
    Ts = kin.forward_many(q)

    def off(found: np.ndarray) -> float:
        return float(np.abs(kin.forward_many(found) - Ts).max())

    def closed() -> int:
        for T in Ts:
            kin.inverse(T)
        return count

    rows = [Contender("twin: closed form, with its checks", closed, count, off(kin.inverse_many(Ts)))]
    of_flange = Ts @ np.linalg.inv(_along())
    rows.append(_iterative("Pinocchio, Levenberg-Marquardt", by_pinocchio(), of_flange, starts, 10.0))
    if installed(table, "roboticstoolbox", "Robotics Toolbox"):
        rows.append(_iterative("Robotics Toolbox, ik_LM in C++ (Chan)", by_toolbox(), of_flange, starts, 10.0))
    many = np.tile(Ts, (effort.of(5000, 500), 1, 1))
    table.facts.append(Fact("inverse_many on a million poses, per second", _rate(kin, many), bar=1e7, least=True))
    table.notes.append(
        f"Iterative solvers start within {NEAR:.0%} of the range of each joint from the solution and stop at "
        f"{TOLERANCE:g}; the closed form needs no start."
    )
    return [race(table, rows, effort)]


def _rate(kin: Any, Ts: np.ndarray) -> float:
    """Return the poses per second of the batch, the best of five."""
    import time

    kin.inverse_many(Ts)
    best = np.inf
    for _ in range(5):
        start = time.perf_counter()
        kin.inverse_many(Ts)
        best = min(best, time.perf_counter() - start)
    return len(Ts) / best


def _along() -> np.ndarray:
    """Return the pose (4, 4) of the tool in frame 6: its z axis is along the closed jaws."""
    return _row(-np.pi / 2, 0.0, 0.0, np.pi / 2)


def _row(alpha: float, a: float, d: float, theta: float) -> np.ndarray:
    ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
    return np.array([[ct, -st, 0, a], [st * ca, ct * ca, -sa, -d * sa], [st * sa, ct * sa, ca, d * ca], [0, 0, 0, 1]])


def _iterative(name: str, solve: Callable, Ts: np.ndarray, starts: np.ndarray, bar: float) -> Contender:
    def run() -> int:
        return sum(bool(solve(T, q0)) for T, q0 in zip(Ts, starts, strict=True))

    return Contender(name, run, len(Ts), good=f"{run()} of {len(Ts)}", bar=bar, counted=True)


def by_pinocchio() -> Callable[[np.ndarray, np.ndarray], bool]:
    """Return damped least squares on Pinocchio's kinematics; damping follows the error, as in Levenberg-Marquardt."""
    import pinocchio as pin

    model, parent = pin.Model(), 0
    for i, (alpha, a, d, theta) in enumerate(ROWS):
        prismatic = i == 2
        fixed = _row(alpha, a, d, theta)  # of the joint at zero: it moves about, or along, z of its own row
        kind = pin.JointModelPZ() if prismatic else pin.JointModelRZ()
        parent = model.addJoint(parent, kind, pin.SE3(fixed[:3, :3], fixed[:3, 3]), f"q{i + 1}")
    data = model.createData()

    def solve(T: np.ndarray, q0: np.ndarray) -> bool:
        target, q = pin.SE3(T), q0.copy()
        for _ in range(100):
            pin.forwardKinematics(model, data, q)
            apart = data.oMi[parent].actInv(target)
            error = pin.log6(apart).vector
            size = float(error @ error)
            if size < TOLERANCE**2:
                return True
            J = pin.Jlog6(apart.inverse()) @ pin.computeJointJacobian(model, data, q, parent)
            q = q + np.linalg.solve(J.T @ J + 1e-3 * size * np.eye(6), J.T @ error)
        return False

    return solve


def by_toolbox() -> Callable[[np.ndarray, np.ndarray], bool]:
    """Return Robotics Toolbox's solver in C++."""
    from roboticstoolbox import ET

    ets = None
    for i, (alpha, a, d, theta) in enumerate(ROWS):
        limits = [LOW[i], HIGH[i]]
        joint = ET.tz(qlim=limits) if i == 2 else ET.Rz(qlim=limits)
        for part in (ET.Rx(alpha), ET.tx(a), ET.Rz(theta), ET.tz(d), joint):
            ets = part if ets is None else ets * part

    def solve(T: np.ndarray, q0: np.ndarray) -> bool:
        found = ets.ik_LM(T, q0, tol=TOLERANCE**2, joint_limits=True, method="chan")  # type: ignore[union-attr]
        return bool(found.success)

    return solve
