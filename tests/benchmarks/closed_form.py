"""Closed-form inverse kinematics of SILS: a million poses at once against hand-written C, and one pose by itself."""

from __future__ import annotations

import ctypes
import hashlib
import math
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import casadi as ca
import numpy as np
from race import Contender, Effort, Table, installed, race

import twin
from twin.codegen import Kernel, Stage
from twin.core import spatial
from twin.formula import equation_values

FLAGS = ("-O3", "-march=native", "-ffp-contract=fast", "-fno-math-errno", "-fno-trapping-math", "-shared", "-fPIC")
JUDGE = "largest difference of a joint in m to numpy's, pose by pose"
L0, L1, L2, LP, LV, LH = 0.050, 0.182, 0.392, 0.135, 0.657, 0.612


def topic(effort: Effort) -> list[Table]:
    """Run the races."""
    work = Work(effort)
    return [coordinates(work, effort), poses(work, effort), single(work, effort)]


class Work:
    """Poses in reach, and the functions of the formula."""

    def __init__(self, effort: Effort) -> None:
        self.count = effort.of(1_000_000, 4_096)  # the short form fits into the cache: neighbours take memory bandwidth
        robot = twin.load("sils")
        self.kin = robot.kinematics()
        rng = np.random.default_rng(0)
        turned = spatial.exp_so3(rng.uniform(-0.3, 0.3, (self.count, 3)))
        moved = spatial.pose(turned, rng.uniform(-0.04, 0.04, (self.count, 3)))
        Ts = robot.loops.forward(robot.loops.q) @ moved
        self.numbers = np.ascontiguousarray(Ts.reshape(-1, 16).T)
        program = self.kin.program
        self.coordinates = np.ascontiguousarray(program.coordinates_of_pose.many(Ts.reshape(-1, 16)).T)
        formula = program.formula
        x = ca.SX.sym("x", 6)
        symbols = {**program.parameters, **dict(zip(formula.coordinates.names, ca.vertsplit(x), strict=True))}
        symbols = equation_values.run(formula, program.variants, symbols, "inverse")
        q = equation_values.gather(formula, symbols, program.order, "joint")
        self.of_coordinates = ca.Function("of_coordinates", [x], [q])
        self.of_pose = program.inverse.function
        self.truth = whole_numpy(self.coordinates)
        self.in_c = build(Path(__file__).with_name("sils_inverse.c").read_text())

    def by_hand(self, name: str, given: np.ndarray, count: int) -> tuple[Callable[[], np.ndarray], np.ndarray]:
        """Return a call of a function of sils_inverse.c, and what it fills."""
        out = np.zeros((count, self.count))
        ins, outs = _pointers(given), _pointers(out)
        function = getattr(self.in_c, name)

        def run() -> np.ndarray:
            function(self.count, ins, outs)
            return out  # which must live as long as the call

        return run, out


def build(text: str) -> ctypes.CDLL | None:
    """Return C compiled by gcc, which only the benchmark uses; None without gcc."""
    if shutil.which("gcc") is None:
        return None
    folder = Path(tempfile.gettempdir()) / f"twin-bench-{hashlib.sha256(text.encode()).hexdigest()[:16]}"
    folder.mkdir(exist_ok=True)
    (folder / "code.c").write_text(text)
    subprocess.run(["gcc", *FLAGS, "code.c", "-o", "code.so", "-lm"], cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "code.so"))


def _pointers(a: np.ndarray) -> ctypes.Array:
    return (ctypes.c_void_p * len(a))(*(a.ctypes.data + i * a.strides[0] for i in range(len(a))))


# -- the paper's equations, as others would write them ------------------------------------------------------


def whole_numpy(x: np.ndarray) -> np.ndarray:
    """Return q (6, k) of coordinates (6, k): arrays all through."""
    return np.array(_rows(np, *x))


def loop_numpy(x: np.ndarray) -> np.ndarray:
    """Return q (6, k): a Python loop on numpy's scalars."""
    return np.array([_rows(np, *row) for row in x.T]).T


def loop_math(x: np.ndarray) -> np.ndarray:
    """Return q (6, k): a Python loop on floats."""
    return np.array([_rows(math, *row) for row in x.T.tolist()]).T


def _rows(m, X, Y, Z, psi, theta, phi):
    ca_, sa, cb, sb, cc, sc = m.cos(psi), m.sin(psi), m.cos(theta), m.sin(theta), m.cos(phi), m.sin(phi)
    a6, a3, a2 = math.sqrt(3) / 6 * LP, math.sqrt(3) / 3 * LP, LP / 2
    out = []
    for k, (x, y, z) in enumerate(
        (
            (
                X + a6 * ca_ * cb - a2 * (ca_ * sb * sc - sa * cc),
                Y + a6 * sa * cb - a2 * (sa * sb * sc + ca_ * cc),
                Z - a6 * sb - a2 * cb * sc,
            ),
            (X - a3 * ca_ * cb, Y - a3 * sa * cb, Z + a3 * sb),
            (
                X + a6 * ca_ * cb + a2 * (ca_ * sb * sc - sa * cc),
                Y + a6 * sa * cb + a2 * (sa * sb * sc + ca_ * cc),
                Z - a6 * sb + a2 * cb * sc,
            ),
        )
    ):
        across, along, sign = ((y, z, 1), (LV - z, y, -1), (LH - y, z, 1))[k]
        h = m.sqrt((L1 + L2) ** 2 - (m.sqrt(x * x + across * across) - L0) ** 2)
        out += [along + sign * (L2 - L1) / (L1 + L2) * h, along + sign * h]
    return out


def in_blocks(x: np.ndarray, block: int = 2048) -> np.ndarray:
    """Return q (6, k): numpy on blocks that stay in the cache."""
    out = np.zeros((6, x.shape[1]))
    for s in range(0, x.shape[1], block):
        out[:, s : s + block] = _rows(np, *x[:, s : s + block])
    return out


def by_numba(x: np.ndarray) -> Callable[[], np.ndarray]:
    """Return the loop over floats compiled by numba."""
    import numba

    a6, a3, a2 = math.sqrt(3) / 6 * LP, math.sqrt(3) / 3 * LP, LP / 2
    bar, share = L1 + L2, (L2 - L1) / (L1 + L2)

    @numba.njit(inline="always")
    def limb(x, across, along, sign, q, k, i):
        h = math.sqrt(bar**2 - (math.sqrt(x * x + across * across) - L0) ** 2)
        q[k, i], q[k + 1, i] = along + sign * share * h, along + sign * h

    @numba.njit(fastmath={"contract", "nsz"}, error_model="numpy")
    def loop(x, q):
        for i in range(x.shape[1]):
            X, Y, Z = x[0, i], x[1, i], x[2, i]
            c1, s1, c2, s2, c3, s3 = (
                math.cos(x[3, i]), math.sin(x[3, i]), math.cos(x[4, i]),
                math.sin(x[4, i]), math.cos(x[5, i]), math.sin(x[5, i]),
            )  # fmt: skip
            xu, yu, xv, yv, zv = c1 * c2, s1 * c2, c1 * s2 * s3 - s1 * c3, s1 * s2 * s3 + c1 * c3, c2 * s3
            limb(X + a6 * xu - a2 * xv, Y + a6 * yu - a2 * yv, Z - a6 * s2 - a2 * zv, 1.0, q, 0, i)
            limb(X - a3 * xu, LV - (Z + a3 * s2), Y - a3 * yu, -1.0, q, 2, i)
            limb(X + a6 * xu + a2 * xv, LH - (Y + a6 * yu + a2 * yv), Z - a6 * s2 + a2 * zv, 1.0, q, 4, i)

    out = np.zeros((6, x.shape[1]))

    def run() -> np.ndarray:
        loop(x, out)
        return out

    return run


def by_map(function: ca.Function, x: np.ndarray, block: int) -> Callable[[], np.ndarray]:
    """Return casadi's own map on samples side by side, called as users call it."""
    mapped = function.map(x.shape[1] if block == 0 else block)
    few = x if block == 0 else x[:, :block]
    return lambda: mapped(few)


def generated(function: ca.Function, count: int) -> str:
    """Return what CasADi writes in C, and a loop over the samples as it wants them (sample after sample)."""
    generator = ca.CodeGenerator("code", {"with_header": False})
    generator.add(function)
    n, m = function.numel_in(0), function.numel_out(0)
    loop = (
        f"void many(long long k, const double *x, double *q) {{\n"
        f"  for (long long i = 0; i < k; i++) {{\n"
        f"    const double *arg[1] = {{x + {n} * i}}; double *res[1] = {{q + {m} * i}};\n"
        f"    {function.name()}(arg, res, 0, 0, 0);\n  }}\n}}\n"
    )
    return generator.dump() + loop


# -- the races ------------------------------------------------------------------------------------------------


def coordinates(work: Work, effort: Effort) -> Table:
    """Six coordinates of the paper in, six joints out."""
    name = f"Closed-form IK of SILS, {work.count} poses at once: six coordinates of the paper -> six joints"
    table = Table("coordinates", name, judge=JUDGE, limit=1e-12)
    x, n = work.coordinates, work.count
    kernel = Kernel([Stage(work.of_coordinates, ("x",), ("q",))], {"x": 6}, ["q"])
    out = (np.zeros((6, n)),)

    def off(q: np.ndarray) -> float:
        return float(np.abs(q - work.truth[:, : q.shape[1]]).max())

    rows = [Contender("twin: kernel, 1 thread", lambda: kernel(x, threads=1, out=out), n, off(kernel(x)[0]))]
    rows.append(Contender("twin: kernel, all processors", lambda: kernel(x, out=out), n))
    rows.append(Contender("twin: kernel, into fresh memory", lambda: kernel(x), n))
    if work.in_c is None:
        print("  !! hand-written C LEFT OUT: no gcc")
        table.missing.append("hand-written C (gcc)")
    else:
        by_hand, q = work.by_hand("joints_of_coordinates", x, 6)
        by_hand()
        rows.append(Contender("hand-written SIMD C, 1 thread", by_hand, n, off(q), bar=0.8))
        rows.append(Contender("the same, a thread for each half", _halves(work, x), n, watched=False))
        rows.append(Contender("roof: as many bytes copied, 1 thread", work.by_hand("roof", x, 6)[0], n, watched=False))
        code = build(generated(work.of_coordinates, n))
        assert code is not None
        samples, joints = np.ascontiguousarray(x.T), np.zeros((n, 6))
        call = lambda: code.many(ctypes.c_longlong(n), _at(samples), _at(joints))  # noqa: E731
        call()
        rows.append(Contender("CasADi's generated C, gcc -O3, 1 thread", call, n, off(joints.T)))
    few = x[:, : effort.of(5000, 500)]
    block = effort.of(100_000, work.count)
    rows.append(Contender("numpy, whole arrays", lambda: whole_numpy(x), n, 0.0))
    rows.append(Contender("numpy, blocks of 2048", lambda: in_blocks(x), n, off(in_blocks(x))))
    if installed(table, "numba", "numba"):
        run = by_numba(x)
        rows.append(Contender("numba, 1 thread", run, n, off(run())))
    mapped = by_map(work.of_coordinates, x, block)
    rows.append(Contender("casadi map", mapped, block, off(np.array(mapped())), bar=100.0))
    rows.append(Contender("Python loop, math", lambda: loop_math(few), few.shape[1], off(loop_math(few))))
    rows.append(Contender("Python loop, numpy", lambda: loop_numpy(few), few.shape[1], off(loop_numpy(few)), bar=500.0))
    table.notes.append(
        "The C is written by hand for this function and gcc: eq. (2) solved for both carriages, constants folded, a "
        "sine and cosine of its own that skips every special case. Both write into memory that is there."
    )
    return race(table, rows, effort)


def _at(a: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(a.ctypes.data)


def _halves(work: Work, x: np.ndarray) -> Callable[[], np.ndarray]:
    pool, out, half = ThreadPoolExecutor(2), np.zeros((6, work.count)), work.count // 16 * 8
    parts = [(half, _pointers(x[:, :half]), _pointers(out[:, :half]))]
    parts.append((work.count - half, _pointers(x[:, half:]), _pointers(out[:, half:])))

    def run() -> np.ndarray:
        list(pool.map(lambda p: work.in_c.joints_of_coordinates(*p), parts))  # type: ignore[union-attr]
        return out

    return run


def poses(work: Work, effort: Effort) -> Table:
    """The compiled inverse itself: a pose in, joints and the misfit of the pose out."""
    title = f"Closed-form IK of SILS, {work.count} poses at once: 16 numbers of a pose -> six joints and its misfit"
    table = Table("poses", title, judge=JUDGE, limit=1e-12)
    x, n = work.numbers, work.count
    kernel = Kernel([Stage(work.of_pose, ("z",), ("out",))], {"z": 16}, ["out"])
    out = (np.zeros((7, n)),)

    def off(q: np.ndarray) -> float:
        return float(np.abs(q[:6] - work.truth[:, : q.shape[1]]).max())

    rows = [Contender("twin: kernel, 1 thread", lambda: kernel(x, threads=1, out=out), n, off(kernel(x)[0]))]
    rows.append(Contender("twin: kernel, all processors", lambda: kernel(x, out=out), n))
    if work.in_c is None:
        table.missing.append("hand-written C (gcc)")
    else:
        same, q = work.by_hand("joints_of_pose", x, 7)
        same()
        rows.append(Contender("hand-written SIMD C, the same function", same, n, off(q), bar=0.8))
        less, q = work.by_hand("joints_of_rotation", x, 6)
        less()
        rows.append(Contender("hand-written SIMD C, no angles, no misfit", less, n, off(q), watched=False))
    Ts = np.ascontiguousarray(x.T.reshape(-1, 4, 4))
    rows.append(Contender("twin: Kinematics.inverse_many(Ts)", lambda: work.kin.inverse_many(Ts), n))
    block = effort.of(50_000, work.count)
    mapped = by_map(work.of_pose, x, block)
    rows.append(Contender("casadi map", mapped, block, off(np.array(mapped())), bar=100.0))
    table.notes.append(
        "The row without angles knows that the rotation is one, and skips Euler's angles, of which the equations are "
        "made, and the test of the pose: what a person gains who rewrites the equations, shown for scale."
    )
    return race(table, rows, effort)


def single(work: Work, effort: Effort) -> Table:
    """One pose a call."""
    table = Table("single", "Closed-form IK of SILS, one pose a call")
    kin, T = work.kin, work.numbers[:, 7].reshape(4, 4)
    evaluator, flat = kin.program.inverse, T.ravel().copy()
    function = work.of_pose
    row = work.coordinates[:, 7]
    kernel = Kernel([Stage(function, ("z",), ("out",))], {"z": 16}, ["out"], single=True).single()
    off = float(np.abs(kernel(flat)[:6] - work.truth[:, 7]).max())
    table.judge, table.limit = JUDGE, 1e-12

    def times(call: Callable[[], object], n: int = 200) -> Callable[[], None]:
        def run() -> None:
            for _ in range(n):
                call()

        return run

    rows = [
        Contender("twin: kernel, one sample", times(lambda: kernel(flat)), 200, off),
        Contender("twin: CasADi's function through its buffer", times(lambda: evaluator.one(flat)), 200),
        Contender("twin: Kinematics.inverse(T), with its checks", times(lambda: kin.inverse(T)), 200),
        Contender("CasADi, f(x)", times(lambda: function(flat)), 200, bar=20.0),
        Contender("CasADi, f(x).full()", times(lambda: function(flat).full()), 200),
        Contender("numpy, scalars", times(lambda: _rows(np, *row)), 200),
        Contender("math, floats", times(lambda: _rows(math, *row.tolist())), 200),
    ]
    return race(table, rows, effort)
