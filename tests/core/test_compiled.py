"""Compiled kernels answer as CasADi does: every operation, NaN where it is NaN, any number of samples and threads."""

from __future__ import annotations

import os
import subprocess
import sys

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import twin
from made.lanes import contrasting, one_of_a_kind
from made.operations import BY_SQUARES, ODD, OPERATIONS, a, b
from twin.codegen import Kernel, Stage
from twin.codegen import kernel as kernel_module
from twin.codegen.lower import lowered
from twin.core import kernel_cache, machine_code

pytestmark = pytest.mark.usefixtures("several_processors")


def both(function: ca.Function, X: np.ndarray, **more) -> tuple[np.ndarray, np.ndarray]:
    kernel = Kernel([Stage(function, ("x",), ("y",))], {"x": len(X)}, ["y"], **more)
    with np.errstate(all="ignore"):
        expected = np.array(function.map(X.shape[1])(X))
    return kernel(X)[0], expected


@pytest.mark.parametrize("single", [True, False])
@pytest.mark.parametrize("name", OPERATIONS)
def test_operation_is_what_casadi_computes(name, single):
    rng = np.random.default_rng(3)
    grid = np.array(np.meshgrid(ODD, ODD)).reshape(2, -1)
    X = np.concatenate(
        [grid, rng.normal(size=(2, 500)), rng.uniform(-1, 1, (2, 300)), rng.normal(size=(2, 99)) * 50], 1
    )
    if name in BY_SQUARES:  # whose squares vanish
        X = X[:, (np.abs(X) != 1e-300).all(axis=0)]
    function = ca.Function("f", [ca.vertcat(a, b)], [OPERATIONS[name]])
    out, expected = both(function, X, single=single)
    assert np.array_equal(np.isnan(out), np.isnan(expected))
    good = np.isfinite(expected)
    assert np.array_equal(out[np.isinf(expected)], expected[np.isinf(expected)])
    assert np.abs(out[good] - expected[good]).max() <= 1e-12
    scale = np.maximum(np.abs(expected[good]), 1e-3 if "sin" in name or "cos" in name or name == "tan" else 1e-300)
    assert (np.abs(out[good] - expected[good]) / scale).max() <= 1e-12


@pytest.mark.parametrize("single", [True, False])
@pytest.mark.parametrize(
    "root",
    [
        lambda x, y: ca.sqrt(x**2 - y**2),
        lambda x, y: ca.sqrt(x * 0.7 - y * 0.7),
        lambda x, y: ca.sqrt(0.37**2 - (0.37 * x / y) ** 2),
        lambda x, y: ca.sqrt(-(y * y) + x * x),
        lambda x, y: x * x - y * y,
    ],
)
def test_a_difference_of_equal_products_is_zero(root, single):
    """As of a stretched arm: a rounding error of one product would make half of the roots NaN."""
    X = np.tile(np.random.default_rng(6).uniform(0.1, 2, 200), (2, 1))
    function = ca.Function("f", [ca.vertcat(a, b)], [root(a, b)])
    out, expected = both(function, X, single=single)
    np.testing.assert_array_equal(out, expected)


@pytest.mark.parametrize("name", OPERATIONS)
def test_an_exact_kernel_has_the_last_bit_of_casadi(name):
    rng = np.random.default_rng(4)
    X = np.concatenate([np.array(np.meshgrid(ODD, ODD)).reshape(2, -1), rng.normal(size=(2, 300)) * 3], 1)
    function = ca.Function("f", [ca.vertcat(a, b)], [OPERATIONS[name]])
    out, expected = both(function, X, single=True, exact=True)
    np.testing.assert_array_equal(out, expected)
    is_number = ~np.isnan(expected)
    np.testing.assert_array_equal(np.signbit(out[is_number]), np.signbit(expected[is_number]))


def test_operations_are_all_of_casadis_instructions_that_formulas_use():
    for name, expression in OPERATIONS.items():
        f = ca.Function("f", [ca.vertcat(a, b)], [expression])
        assert f.n_instructions() > 2, name
    assert set(lowered()) >= {ca.OP_ATAN2, ca.OP_ASIN, ca.OP_ACOS, ca.OP_ATAN, ca.OP_TAN}


@pytest.mark.parametrize("size", [1e3, 1e6, 9e8])
def test_sine_of_large_arguments(size):
    X = np.random.default_rng(0).uniform(-size, size, (1, 4000))
    out, _ = both(ca.Function("f", [a], [ca.vertcat(ca.sin(a), ca.cos(a))]), X)
    assert np.abs(out - [np.sin(X[0]), np.cos(X[0])]).max() <= 4e-16


def test_sine_beyond_meaning_is_nan():
    out, _ = both(ca.Function("f", [a], [ca.sin(a)]), np.array([[1e10, np.inf, -np.inf, np.nan]]))
    assert np.isnan(out).all()


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=70))
def test_any_number_of_samples(values):
    X = np.array([values])
    out, expected = both(ca.Function("f", [a], [ca.vertcat(3 * a, a - 1)]), X)
    assert np.array_equal(out, expected)


@pytest.mark.parametrize("threads", [1, 2, 7, None])
def test_threads_change_nothing(threads):
    X = np.random.default_rng(1).normal(size=(2, 20_011))
    function = ca.Function("f", [ca.vertcat(a, b)], [ca.vertcat(ca.atan2(a, b), ca.sin(a) * b)])
    kernel = Kernel([Stage(function, ("x",), ("y",))], {"x": 2}, ["y"])
    assert np.array_equal(kernel(X, threads=threads)[0], kernel(X, threads=1)[0])


def root() -> Stage:
    """Newton's method for the square root of p, from x."""
    new = 0.5 * (a + b / a)
    return Stage(ca.Function("step", [a, b], [new, ca.fabs(new - a)]), ("x", "p"), ("x", "error"), 60, 1e-12)


def test_an_interrupted_computation_leaves_its_arrays_to_its_threads(monkeypatch):
    """A thread that still computes after a Ctrl-C writes into memory that nobody has freed, and takes no more."""
    x = ca.SX.sym("x")
    kernel = Kernel([Stage(ca.Function("f", [x], [x + 1]), ("x",), ("y",))], {"x": 1}, ["y"])
    calls, threads = [], []

    def interrupted(begin, end, *_):
        calls.append(begin)
        if len(calls) > 1:
            raise KeyboardInterrupt

    monkeypatch.setattr(kernel, "_call", interrupted)
    monkeypatch.setattr(kernel_module, "_share", lambda work, *_: threads.append(work) or work())
    with pytest.raises(KeyboardInterrupt):
        kernel(np.zeros((1, 100_000)))
    threads[0]()  # a helper that starts late
    assert len(calls) == 2
    assert any(isinstance(a, np.ndarray) and a.size == 100_000 for part in threads[0].__defaults__[0] for a in part)


@pytest.mark.parametrize("single", [True, False])
def test_repeated_stage_ends_when_every_lane_has_converged(single):
    P = np.random.default_rng(2).uniform(1e-3, 1e6, (1, 1001))
    kernel = Kernel([root()], {"p": 1, "x": 1}, ["x", "error"], single=single)
    x, error = kernel(P, np.ones_like(P))
    assert np.abs(x / np.sqrt(P) - 1).max() < 1e-15
    assert error.max() <= 1e-12


def test_a_result_does_not_depend_on_its_neighbours():
    """Samples that need few steps are not changed by steps for others; sums are fused as in one lane."""
    rng = np.random.default_rng(4)
    P = rng.uniform(1e-3, 1e6, (1, 999))
    start = rng.uniform(1e-2, 1e3, (1, 999))
    turned = Stage(ca.Function("turned", [a, b], [a * b - b * b, ca.sin(a) * b + a / b]), ("x", "p"), ("y", "z"))
    names = ["x", "error", "y", "z"]
    together = Kernel([root(), turned], {"p": 1, "x": 1}, names)(P, start)
    alone = Kernel([root(), turned], {"p": 1, "x": 1}, names, single=True)(P, start)
    shuffled = rng.permutation(999)
    elsewhere = Kernel([root(), turned], {"p": 1, "x": 1}, names)(P[:, shuffled], start[:, shuffled])
    for one, other, third in zip(together, alone, elsewhere, strict=True):
        np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(one[:, shuffled], third)


def test_repeated_stage_ends_with_nan_and_after_its_limit():
    kernel = Kernel([root()], {"p": 1, "x": 1}, ["x"])
    (x,) = kernel(np.array([[np.nan, 4.0, -1.0]]), np.array([[1.0, 1.0, 1.0]]))
    assert np.isnan(x[0, 0])
    assert x[0, 1] == 2.0


def test_stages_hand_on_by_name():
    square = Stage(ca.Function("square", [a], [a * a]), ("p",), ("s",))
    twice = Stage(ca.Function("twice", [a, b], [a + b, a - b]), ("s", "p"), ("sum", "difference"))
    kernel = Kernel([square, twice], {"p": 1}, ["difference", "sum"])
    difference, total = kernel(np.array([[1.0, 2.0, 3.0]]))
    assert difference.tolist() == [[0.0, 2.0, 6.0]]
    assert total.tolist() == [[2.0, 6.0, 12.0]]


def test_carry_is_taken_over_from_sample_to_sample():
    stage = Stage(ca.Function("sum", [a, b], [a + b, a]), ("total", "x"), ("total", "before"))
    kernel = Kernel([stage], {"x": 1}, ["total", "before"], carried={"total": 1})
    carry = np.array([100.0])
    total, before = kernel(np.arange(1.0, 6.0)[None], carry=carry)
    assert total.tolist() == [[101.0, 103.0, 106.0, 110.0, 115.0]]
    assert before.tolist() == [[100.0, 101.0, 103.0, 106.0, 110.0]]
    assert carry.tolist() == [115.0]


def test_results_go_where_they_are_wanted():
    kernel = Kernel([root()], {"p": 1, "x": 1}, ["x", "error"])
    P = np.random.default_rng(4).uniform(1, 9, (1, 1003))
    x, error = np.zeros((1, 1003)), np.zeros((1, 1003))
    given = kernel(P, np.ones_like(P), out=(x, error))
    assert given[0] is x
    assert np.array_equal(x, kernel(P, np.ones_like(P))[0])
    for wrong in (x[:, 1:], x.astype(np.float32), np.zeros((1, 2006))[:, ::2], np.broadcast_to(0.0, x.shape)):
        with pytest.raises(ValueError, match=r"out for 'x' is not a contiguous float64 array of shape \(1, 1003\)"):
            kernel(P, np.ones_like(P), out=(wrong, error))


@pytest.mark.parametrize("count", [0, 1, 7, 1024, 1025, 5000])
def test_samples_in_rows_give_the_rows_of_the_results(count):
    """Blocks, their ends, and several threads; samples that lie apart are read where they lie."""
    x = ca.SX.sym("x", 3)
    kernel = Kernel(
        [Stage(ca.Function("f", [x], [ca.vertcat(ca.sqrt(x), x[0] * x[1])]), ("x",), ("y",))], {"x": 3}, ["y"]
    )
    Z = np.random.default_rng(7).normal(size=(count, 5))
    for rows in (Z[:, :3], Z[:, 1:4][::-1], np.asfortranarray(Z[:, :3])):
        got = kernel.rows(rows)
        assert got.shape == (count, 4)
        assert got.flags.c_contiguous
        assert np.array_equal(got, kernel(rows.T)[0].T, equal_nan=True)
    with pytest.raises(ValueError, match="samples have shape"):
        kernel.rows(Z)


@pytest.mark.parametrize("divisor", [3.0, -0.1, 1e-320, np.inf, 0.0, -0.0, np.nan, 1e308])
def test_division_by_a_number(divisor):
    function = ca.Function("f", [a], [a / ca.SX(divisor)])
    out, expected = both(function, np.array([ODD]))
    assert np.array_equal(np.isnan(out), np.isnan(expected))
    assert np.array_equal(np.signbit(out), np.signbit(expected)) or divisor != divisor
    np.testing.assert_allclose(out, expected, rtol=3e-16)


@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_backwards_the_carry_comes_from_the_sample_after(count):
    stage = Stage(ca.Function("sum", [a, b], [a + b, a]), ("total", "x"), ("total", "before"))
    kernel = Kernel([stage], {"x": 1}, ["total", "before"], carried={"total": 1}, backwards=True)
    carry = np.array([100.0])
    total, before = kernel(np.arange(1.0, 6.0)[None, :count], carry=carry)
    assert total.tolist() == [[100.0 + sum(range(i, count + 1)) for i in range(1, count + 1)]]
    assert (before + np.arange(1.0, count + 1)).tolist() == total.tolist()
    assert carry[0] == 100.0 + sum(range(count + 1))
    with pytest.raises(ValueError, match="argument `carry` is missing for total"):
        kernel(np.ones((1, 3)))


@pytest.mark.parametrize("carried", [{}, {"none": 1}])
def test_rows_of_slices_are_read_where_they_lie(carried):
    X = np.random.default_rng(6).normal(size=(4, 300))
    x = ca.SX.sym("x", 2)
    stages = [Stage(ca.Function("f", [x], [x - 2 * x[::-1]]), ("x",), ("y",))]
    kernel = Kernel(stages, {"x": 2}, ["y"], carried=carried)
    more = {"carry": np.zeros(1)} if carried else {}
    for part in (X[::2, 5:], X[1:3, :-7], X[:2, ::3], X[:2, ::-1], np.asfortranarray(X[:2]), X[1:3, 9:10], X[2:0:-1]):
        assert np.array_equal(kernel(part, **more)[0], kernel(part.copy(), **more)[0])
        np.testing.assert_allclose(kernel(part, **more)[0], part - 2 * part[::-1], atol=1e-15)


def test_what_cannot_be_compiled_is_named():
    function = ca.Function("gauss", [a], [ca.erf(a)])
    with pytest.raises(ValueError, match="function 'gauss': CasADi's operation"):
        Kernel([Stage(function, ("x",), ("y",))], {"x": 1}, ["y"])


def test_arrays_of_another_shape_are_refused():
    kernel = Kernel([root()], {"p": 1, "x": 1}, ["x"])
    with pytest.raises(ValueError, match=r"'x' has shape \(2, 3\), not \(1, 3\)"):
        kernel(np.ones((1, 3)), np.ones((2, 3)))
    with pytest.raises(ValueError, match="1 arrays given, expected one for each of p, x"):
        kernel(np.ones((1, 3)))


# -- the cache -----------------------------------------------------------------------------------------


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "twin" / "kernels"


def compile_one(factor: float = 3.0) -> float:
    function = ca.Function("f", [a], [factor * a])
    return float(Kernel([Stage(function, ("x",), ("y",))], {"x": 1}, ["y"])(np.ones((1, 1)))[0][0, 0])


def test_kernel_is_compiled_once(cache, monkeypatch):
    assert compile_one() == 3.0
    monkeypatch.setattr(machine_code, "_object_code", lambda *_: pytest.fail("compiled again"))
    assert compile_one() == 3.0
    assert len(list(cache.iterdir())) == 1
    assert cache.stat().st_mode & 0o777 == 0o700


def test_other_numbers_are_another_kernel(cache):
    assert (compile_one(3.0), compile_one(4.0)) == (3.0, 4.0)
    assert len(list(cache.glob("*.o"))) == 2


@pytest.mark.parametrize(
    "damage", [lambda d: d[: len(d) // 2], lambda d: d[:-1] + b"\x00", lambda d: b"", lambda d: d[::-1]]
)
def test_damaged_file_is_compiled_anew(cache, damage):
    compile_one()
    (file,) = cache.glob("*.o")
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    assert compile_one() == 3.0
    assert len(file.read_bytes()) == len(whole)


@pytest.mark.parametrize("which", ["file", "folder"])
def test_what_others_may_write_is_not_loaded(cache, which, monkeypatch):
    compile_one()
    (file,) = cache.glob("*.o")
    (file if which == "file" else cache).chmod(0o777)
    done = []
    code = machine_code._object_code
    monkeypatch.setattr(machine_code, "_object_code", lambda *x: done.append(1) or code(*x))
    assert compile_one() == 3.0
    assert done


def test_cache_that_cannot_be_written_is_no_error(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert compile_one() == 3.0


def test_cache_keeps_the_newest(cache, monkeypatch):
    monkeypatch.setattr(kernel_cache, "_CACHED", 3)
    for i in range(6):
        compile_one(i + 1.5)
        for k, file in enumerate(sorted(cache.glob("*.o"), key=lambda p: p.stat().st_mtime)):
            os.utime(file, (k, k))
    assert len(list(cache.glob("*.o"))) == 4


# -- formulas of robots ----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", contrasting())
def test_formulas_give_the_same_in_many_rows_and_in_few(name, monkeypatch):
    from twin.core import spatial
    from twin.formula import evaluator

    rng = np.random.default_rng(5)
    robot = twin.load(name)
    kin = robot.kinematics()
    T = spatial.pose(spatial.exp_so3(rng.uniform(-0.8, 0.8, (500, 3))), rng.uniform(-0.3, 0.3, (500, 3)))
    T[::50] = robot.loops.forward(robot.loops.q)  # with less than six freedoms few other poses have an answer
    rows = T.reshape(-1, 16) if kin.closed_inverse else rng.uniform(-2, 2, (500, len(kin.joints)))
    program = kin.program
    evaluators = [program.points, *program.group.values()]
    if kin.closed_inverse:
        evaluators += [program.inverse, program.judged_inverse, program.inverse_jacobian]
    evaluators += [program.forward, program.forward_jacobian] if kin.closed_forward and not kin.closed_inverse else []
    for compiled in evaluators:
        few = compiled.many(rows)
        monkeypatch.setattr(evaluator, "_KERNEL_SAMPLES", 10)
        many = compiled.many(rows)
        monkeypatch.undo()
        assert np.array_equal(np.isnan(few), np.isnan(many)), compiled.name
        flat, difference = np.abs(few).reshape(500, -1), np.abs(many - few).reshape(500, -1)
        if flat.size:  # near a singularity large terms cancel: of each row the largest number counts
            most = np.max(np.where(np.isfinite(flat), flat, 0), axis=1, keepdims=True)
            # There, a rounding of the input alone may change the result by more than that.
            rounded = compiled.many(rows * (1 + np.finfo(float).eps * rng.choice([-1, 1], rows.shape)))
            by_input = np.nanmax(np.abs(rounded - few).reshape(500, -1), axis=1, keepdims=True, initial=0)
            assert np.nanmax(difference / np.maximum(np.maximum(most, 1), 1e12 * by_input)) < 1e-12, compiled.name
        assert compiled.function.size1_out(0) == 0 or compiled._kernel is not None


def test_rootfinders_are_left_to_casadi():
    import twin

    newton = twin.load("sils").kinematics().program.newton
    assert newton._kernel is None


SCATTERED = """
import mmap
import twin
from twin.codegen import kernel
from twin.core import kernel_cache, machine_code
from twin.analysis.error_propagation import ErrorPropagation, Spread
texts = []
kernel.compiled = lambda text: texts.append(text) or machine_code.compiled(text)
mechanism = twin.load("hibou").mechanism
ErrorPropagation(mechanism, Spread(1e-5, 1e-5, 1e-6, 1e-5)).budget("home", mechanism.posture("home"), 1000)
kept, taken = [], []
for i in range(60):
    kept.append(machine_code.compiled(max(texts, key=len)))
    taken.append(mmap.mmap(-1, 512 << 20))
    if i % 2:
        taken[-2].close()
"""
"""Kernels that are kept while memory around them is taken and given back: address space only, nothing is written."""


@pytest.mark.slow
def test_a_kernel_is_linked_in_scattered_memory():
    """LLVM ends the process if code and constants lie more than 2 GB apart."""
    done = subprocess.run([sys.executable, "-c", SCATTERED], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-500:]


@pytest.mark.parametrize("name", one_of_a_kind())
@pytest.mark.parametrize("many", [10, 10_000], ids=["kernel", "casadi"])
def test_a_batch_of_poses_has_the_answers_of_each_and_nan_where_there_is_none(name, many, monkeypatch):
    from twin.core import spatial
    from twin.core.errors import KinematicsError
    from twin.formula import evaluator

    monkeypatch.setattr(evaluator, "_KERNEL_SAMPLES", many)
    kin, rng = twin.load(name).kinematics(), np.random.default_rng(8)
    if not kin.closed_inverse:
        pytest.skip(f"{name} has no closed inverse")
    home = kin.program.pose_of_coordinates.one(np.array(kin.formula.seeds[0], float))
    T = home @ spatial.pose(spatial.exp_so3(rng.uniform(-0.1, 0.1, (60, 3))), rng.uniform(-0.02, 0.02, (60, 3)))
    T[::20] = home  # with less than six freedoms few other poses have an answer
    T[3, :3, :3] *= 1.001  # not rigid
    T[7, 0, 3] = np.nan
    T[11, 1, 3] = np.inf
    T[13, :3, 3] += 100.0  # out of reach
    q, lost = kin.inverse_many(T), []
    for i, one in enumerate(T):
        try:
            np.testing.assert_allclose(q[i], kin.inverse(one), atol=1e-9)
        except KinematicsError:
            lost.append(i)
            assert np.isnan(q[i]).all()
    assert {3, 7, 11} <= set(lost)
    assert not {0, 20, 40} & set(lost)
