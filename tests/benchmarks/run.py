"""Side-by-side benchmarks: contenders take turns in one process, ratios of medians are printed (`make bench`).

Absolute times depend on the machine and its load; ratios do not. Nothing here is a test.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections.abc import Callable

import numpy as np
from race import race

import twin
from twin.control.velocity import Limits, pose_error, step


def trocar_race() -> None:
    """Tip and trocar of the PA-10 from random starts: time per success, not per try."""
    import casadi as ca
    from scipy.optimize import least_squares

    from twin.kinematics import Tip, Trocar, compile_formula, solve
    from twin.kinematics.flow import Evaluator
    from twin.kinematics.srs import SrsArm
    from twin.kinematics.tasks import residual
    from twin.robots import load_formula

    kin = compile_formula(load_formula("pa10"))
    half = np.radians([177, 94, 174, 137, 255, 165, 255])
    limits = np.stack([-half, half], axis=1)
    arm = SrsArm(0.45, 0.48, 0.40, limits[:6])
    rng = np.random.default_rng(0)
    Ts = kin.forward_many(rng.uniform(-half, half, (60, 7)))
    problems = [(T[:3, 3], T[:3, 3] - d * T[:3, 2]) for T, d in zip(Ts, rng.uniform(0.05, 0.35, 60), strict=True)]
    starts = rng.uniform(-half, half, (60, 7))

    def closed() -> int:
        return sum(arm.solve(tip, trocar).margin > 0 for tip, trocar in problems)

    def general() -> int:
        good = 0
        for i, (tip, trocar) in enumerate(problems):
            found = solve(kin, Tip(tip) + Trocar(trocar, axis=(0, 0, 1)), limits=limits, any_branch=True, rng=i)
            good += found.residual < 1e-9
        return good

    # What a user of scipy would compile: residual and exact Jacobian, padded since 'lm' wants as many rows as unknowns.
    z = ca.SX.sym("z", 13)
    T, q = kin.program.around(ca.SX.zeros(7), z[:7])
    rows = ca.vertcat(
        residual("tip", (0, 1, 2), T, q, ca.vertcat(z[7:10], ca.SX.zeros(3))),
        residual("trocar", (0, 1, 2), T, q, ca.vertcat(z[10:13], 0, 0, 1, ca.SX.zeros(3))),
        0,
    )
    value, derivative = Evaluator("r", z, rows), Evaluator("J", z, ca.jacobian(rows, z[:7]), (7, 7))

    def scipy_lm(exact: bool) -> int:
        good = 0
        for (tip, trocar), q0 in zip(problems, starts, strict=True):
            target = np.concatenate([tip, trocar])
            found = least_squares(
                lambda q, target=target: value.one(np.concatenate([q, target])),
                q0,
                (lambda q, target=target: derivative.one(np.concatenate([q, target]))) if exact else "2-point",
                method="lm",
                xtol=1e-14,
                ftol=1e-14,
            )
            q = np.angle(np.exp(1j * found.x))  # a turn more or less is the same posture
            good += bool(np.linalg.norm(found.fun) < 1e-9 and (np.abs(q) <= half).all())
        return good

    def scipy_plain() -> int:
        """Return the successes of what is written down first: a residual in numpy, no derivative."""
        good = 0
        for (tip, trocar), q0 in zip(problems, starts, strict=True):

            def miss(q: np.ndarray, tip=tip, trocar=trocar) -> np.ndarray:
                T = kin.forward(q)
                w = trocar - T[:3, 3]
                return np.concatenate([T[:3, 3] - tip, w + np.linalg.norm(w) * T[:3, 2], [0.0]])

            found = least_squares(miss, q0, method="lm", xtol=1e-14, ftol=1e-14)
            q = np.angle(np.exp(1j * found.x))
            good += bool(np.linalg.norm(found.fun) < 1e-9 and (np.abs(q) <= half).all())
        return good

    contenders: dict[str, Callable[[], int]] = {
        "closed form, with its scan and limits": closed,
        "general solver (Levenberg-Marquardt), multi-start": general,
        "scipy least_squares('lm'), exact Jacobian, one start": lambda: scipy_lm(True),
        "scipy least_squares('lm'), finite differences": lambda: scipy_lm(False),
        "the same, residual in numpy": scipy_plain,
    }
    title = "tip and trocar of the PA-10, random starts: time per success within the limits"
    race(title, contenders, tries=len(problems))


def main() -> None:
    """Run all races on SILS."""
    robot = twin.load("sils")
    kin = robot.kinematics()
    q0, q1 = (robot.mechanism.posture(n) for n in ("insertion", "inserted"))
    T = robot.forward(q0)
    evaluator = kin.program.inverse
    flat = T.ravel()
    plain = evaluator.function
    race(
        "inverse kinematics, one pose",
        {
            "compiled function through its buffer": lambda: [evaluator.one(flat) for _ in range(2000)],
            "Kinematics.inverse, with its checks": lambda: [kin.inverse(T) for _ in range(2000)],
            "the same function called as f(x)": lambda: [plain(flat) for _ in range(2000)],
        },
        per=2000,
    )
    model = robot.reference()
    motion = q0 + (0.5 - 0.5 * np.cos(np.linspace(0, np.pi, 1000)))[:, None] * (q1 - q0)

    def one_by_one() -> None:
        state = None
        for q in motion:
            state = model.solve(q, state)

    race(
        "independent model, per sample of a 1 kHz motion",
        {
            "run: coarse walk, then all samples together": lambda: model.run(motion),
            "solve: each sample from the one before": one_by_one,
        },
        per=len(motion),
    )
    run, single = model.run(motion), model.solve(motion[-1])
    print(f"  largest gap {run.gaps[..., 0].max():.1e} m, runs differ by "
          f"{np.abs(run.Ts_base_tool[-1] - single.T_base_tool).max():.1e} m")  # fmt: skip
    control()


def control() -> None:
    """Race the solvers of a control tick on SHER: Algorithm 2.1's SLSQP against damped least squares."""
    robot = twin.load("sher")
    kin, active = robot.kinematics(), robot.mechanism.active
    low, high = np.array([j.limits for j in active]).T
    limits = Limits(low, high, np.array([j.max_speed for j in active]))
    home = robot.mechanism.posture("home")
    near, far = np.array([1e-6, -1e-6, 2e-6, 1e-5, 1e-6]), np.array([4e-3, -3e-3, 2e-3, 0.15, 5e-3])
    for title, goal in (("free, some um away", home + near), ("rates at their bounds, some mm away", home + far)):
        T = kin.forward(goal)

        def ticks(solver, T=T) -> None:
            for _ in range(50):
                step(kin, home, T, 1e-3, limits, solver)

        contenders = {
            "damped least squares, bounded": lambda: ticks("damped"),
            "SLSQP (Algorithm 2.1)": lambda: ticks("slsqp"),
        }
        race(f"one control tick of SHER at 1 kHz, {title}", contenders, per=50)
        for solver in ("damped", "slsqp"):
            q, count, left = home, 0, 1.0
            while left > 1e-9 and count < 5000:
                q, count = step(kin, q, T, 1e-3, limits, solver).q, count + 1  # type: ignore[arg-type]
                left = float(np.linalg.norm(pose_error(kin.forward(q), T)))
            print(f"  {solver:8s} {count} ticks to an error of {left:.1e} (m, rad)")

    trocar_race()


if __name__ == "__main__":
    main()
