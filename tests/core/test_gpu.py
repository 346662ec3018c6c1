"""Kernels for a GPU give the answers of the processor, which also runs their text here: made/processor_as_gpu.py."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import twin
from made.lanes import one_of_a_kind
from made.operations import BY_SQUARES, ODD, OPERATIONS, a, b
from made.processor_as_gpu import ProcessorAsGpu
from twin.codegen import Kernel, Stage, gpu_kernel
from twin.codegen import kernel as kernel_module
from twin.core import compute_device, gpu
from twin.core.compute_device import PROCESSOR, computing_on, current
from twin.core.errors import GpuError, TwinError
from twin.formula import evaluator

MISSING = "driver is missing|is an NVIDIA driver library"

BY_THE_C_LIBRARY = {"exp", "log", "pow", "constpow", "sinh", "cosh", "tanh"}


@pytest.fixture
def card(monkeypatch) -> ProcessorAsGpu:
    """A GPU of this computer, which takes any number of samples."""
    card = ProcessorAsGpu()
    monkeypatch.setattr(gpu, "found", lambda: (card, ""))
    monkeypatch.setattr(kernel_module, "_FEWEST_GPU_SAMPLES", 1)
    monkeypatch.setattr(evaluator, "_KERNEL_SAMPLES", 1)  # CasADi, which would compute few poses, rounds otherwise
    return card


@pytest.fixture
def no_card(monkeypatch):
    monkeypatch.setattr(gpu, "found", lambda: (None, "the NVIDIA driver is missing"))


def product() -> Kernel:
    """Return the kernel of (x y, x + z) for x (2,), y and z numbers."""
    x = ca.SX.sym("x", 2)
    y = ca.SX.sym("y")
    function = ca.Function("f", [x, y], [x * y, x[0] - y])
    return Kernel([Stage(function, ("x", "y"), ("product", "difference"))], {"x": 2, "y": 1}, ["product", "difference"])


@pytest.mark.parametrize("name", OPERATIONS)
def test_operation_is_what_the_processor_computes(name, card):
    rng = np.random.default_rng(3)
    X = np.concatenate([np.array(np.meshgrid(ODD, ODD)).reshape(2, -1), rng.normal(size=(2, 500)) * 3], 1)
    if name in BY_SQUARES:
        X = X[:, (np.abs(X) != 1e-300).all(axis=0)]
    function = ca.Function("f", [ca.vertcat(a, b)], [OPERATIONS[name]])
    kernel = Kernel([Stage(function, ("x",), ("y",))], {"x": 2}, ["y"])
    (expected,) = kernel(X)
    with computing_on("gpu") as device:
        (out,) = kernel(X)
    assert device.name == (PROCESSOR if name in BY_THE_C_LIBRARY else card.name)
    np.testing.assert_array_equal(out, expected)


@pytest.mark.parametrize("samples", [1, 127, 128, 129, 1000])
def test_samples_pass_in_blocks(samples, card, monkeypatch):
    monkeypatch.setattr(gpu_kernel, "_BLOCK_SAMPLES", 128)
    kernel = product()
    rng = np.random.default_rng(0)
    x = rng.normal(size=(2, samples))
    y = rng.normal(size=(1, samples))
    expected = kernel(x, y)
    with computing_on("gpu"):
        found = kernel(x, y)
        again = kernel(x, y)
    assert len(card.launches) == 2 * -(-samples // 128)
    assert card.modules == 1
    for one, other, third in zip(expected, found, again, strict=True):
        np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(one, third)


def test_slices_and_given_arrays_are_read_and_filled(card):
    kernel = product()
    x = np.arange(40.0).reshape(4, 10)[::2]
    y = np.arange(20.0).reshape(1, 20)[:, ::2]
    out = (np.zeros((2, 10)), np.zeros((1, 10)))
    with computing_on("gpu"):
        kernel(x, y, out=out)
    np.testing.assert_array_equal(out[0], x * y)
    np.testing.assert_array_equal(out[1], x[:1] - y)


def test_samples_in_rows_give_the_rows_of_the_results(card, monkeypatch):
    monkeypatch.setattr(gpu_kernel, "_BLOCK_SAMPLES", 100)
    x = ca.SX.sym("x", 3)
    kernel = Kernel(
        [Stage(ca.Function("f", [x], [ca.vertcat(ca.sin(x), x[0] * x[2])]), ("x",), ("y",))], {"x": 3}, ["y"]
    )
    Z = np.random.default_rng(1).normal(size=(777, 3))
    expected = kernel.rows(Z)
    with computing_on("gpu") as device:
        found = kernel.rows(Z)
    assert device.name == card.name
    np.testing.assert_array_equal(found, expected)


def test_blocks_are_smaller_where_memory_is_short(card):
    kernel = product()
    x = np.ones((2, 1000))
    y = np.ones((1, 1000))
    card.free = 40_000  # half of it, for two lanes of 48 bytes a sample: 208 samples
    for _ in range(5):
        with computing_on("gpu"):
            kernel(x, y)
        assert card.launches == [(2, 128)] * 5
        assert sum(memory.nbytes for memory in card.memory.values()) <= 20_000
        card.launches.clear()


def test_a_full_card_is_an_error_and_the_next_call_computes(card, monkeypatch):
    kernel = product()
    x = np.ones((2, 1000))
    y = np.full((1, 1000), 3.0)
    reserved = card.reserved
    calls = []

    def once(count):
        calls.append(count)
        if len(calls) == 1:
            raise GpuError("full")
        return reserved(count)

    monkeypatch.setattr(card, "reserved", once)
    with computing_on("gpu"), pytest.raises(GpuError, match="full"):
        kernel(x, y)
    with computing_on("gpu"):
        np.testing.assert_array_equal(kernel(x, y)[0], 3 * x)


def test_auto_goes_on_with_the_processor_where_the_gpu_fails(card, monkeypatch):
    monkeypatch.setattr(kernel_module, "_GPU_LOADING_S", 0.0)
    monkeypatch.setattr(gpu_kernel, "_BYTES_PER_S", 1e30)
    monkeypatch.setattr(gpu_kernel, "_BLOCK_START_S", 0.0)
    card.free = 100
    x = np.ones((2, 50_000))
    y = np.full((1, 50_000), 2.0)
    with computing_on("auto"):
        found = product()(x, y)
    np.testing.assert_array_equal(found[0], 2 * x)
    np.testing.assert_array_equal(found[1], x[:1] - 2)


def test_the_choice_of_the_environment_names_what_has_computed(card, monkeypatch):
    monkeypatch.setenv("TWIN_DEVICE", "gpu")
    monkeypatch.setattr(compute_device, "_of_environment", {})
    product()(np.ones((2, 100)), np.ones((1, 100)))
    assert current().name == card.name


def test_too_little_memory_is_an_error_that_names_both_sizes(card):
    card.free = 5000
    with (
        computing_on("gpu"),
        pytest.raises(GpuError, match=r"0\.005 MB of free memory.*needs 0\.0246 MB.*--device cpu"),
    ):
        product()(np.ones((2, 1000)), np.ones((1, 1000)))


def test_an_interruption_waits_for_the_blocks_under_way(card, monkeypatch):
    monkeypatch.setattr(gpu_kernel, "_BLOCK_SAMPLES", 128)
    kernel = product()
    copy_to = card.copy_to
    copies = []

    def interrupted(*arguments):
        copies.append(arguments)
        if len(copies) == 2:
            raise KeyboardInterrupt
        copy_to(*arguments)

    monkeypatch.setattr(card, "copy_to", interrupted)
    x = np.ones((2, 1000))
    y = np.full((1, 1000), 3.0)
    with computing_on("gpu"), pytest.raises(KeyboardInterrupt):
        kernel(x, y)
    assert not any(card.waiting)
    with computing_on("gpu"):
        np.testing.assert_array_equal(kernel(x, y)[0], 3 * x)


def test_kernels_that_depend_on_the_sample_before_stay_on_the_processor(card):
    c, x = ca.SX.sym("c"), ca.SX.sym("x")
    stage = Stage(ca.Function("sum", [c, x], [c + x]), ("c", "x"), ("c",))
    kernel = Kernel([stage], {"x": 1}, ["c"], carried={"c": 1})
    with computing_on("gpu") as device:
        (sums,) = kernel(np.ones((1, 50)), carry=np.zeros(1))
    assert device.name == PROCESSOR
    np.testing.assert_array_equal(sums[0], np.arange(1, 51))


def test_few_samples_stay_on_the_processor(monkeypatch):
    card = ProcessorAsGpu()
    monkeypatch.setattr(gpu, "found", lambda: (card, ""))
    with computing_on("gpu") as device:
        product()(np.ones((2, 100)), np.ones((1, 100)))
    assert device.name == PROCESSOR


def test_auto_moves_to_the_gpu_when_loading_it_has_paid(card, monkeypatch):
    kernel = product()
    x = np.ones((2, 50_000))
    y = np.full((1, 50_000), 2.0)
    with computing_on("auto") as device:
        kernel(x, y)
    assert device.name == PROCESSOR  # the processor has not been busy for long

    monkeypatch.setattr(kernel_module, "_GPU_LOADING_S", 0.0)
    with computing_on("auto") as device:
        kernel(x, y)
    assert device.name == PROCESSOR  # copying takes longer than the processor

    monkeypatch.setattr(gpu_kernel, "_BYTES_PER_S", 1e30)
    monkeypatch.setattr(gpu_kernel, "_BLOCK_START_S", 0.0)
    with computing_on("auto") as device:
        found = kernel(x, y)
    assert device.name == card.name
    np.testing.assert_array_equal(found[0], 2 * x)
    np.testing.assert_array_equal(found[1], x[:1] - 2)
    with computing_on("auto") as device:
        rows = one_input().rows(np.ones((50_000, 2)))
    assert device.name == card.name
    np.testing.assert_array_equal(rows, 2 * np.ones((50_000, 2)))


def one_input() -> Kernel:
    x = ca.SX.sym("x", 2)
    return Kernel([Stage(ca.Function("f", [x], [x + x]), ("x",), ("y",))], {"x": 2}, ["y"])


def test_without_a_gpu_auto_is_the_processor(no_card, monkeypatch):
    monkeypatch.setattr(kernel_module, "_GPU_LOADING_S", 0.0)
    with computing_on("auto") as device:
        product()(np.ones((2, 50_000)), np.ones((1, 50_000)))
    assert device.name == PROCESSOR


def test_without_a_gpu_gpu_is_an_error_that_says_why(no_card):
    with (
        computing_on("gpu"),
        pytest.raises(GpuError, match="the NVIDIA driver is missing; choose --device cpu or auto"),
    ):
        product()(np.ones((2, 5000)), np.ones((1, 5000)))


def test_the_choice_of_the_environment_holds_outside_of_blocks(monkeypatch):
    assert current().choice == "cpu"
    monkeypatch.setenv("TWIN_DEVICE", "auto")
    assert current().choice == "auto"
    with computing_on("cpu"):
        assert current().choice == "cpu"
    monkeypatch.setenv("TWIN_DEVICE", "gpuu")
    with pytest.raises(TwinError, match=r"no compute device 'gpuu'\. Did you mean 'gpu'"):
        current()


def random_states(robot: twin.Robot, count: int) -> np.ndarray:
    """Return joint values (count, n) within the limits and a tenth of their range beyond."""
    limits = np.where(np.isfinite(robot.mechanism.limits), robot.mechanism.limits, [-np.pi, np.pi])
    beyond = 0.1 * np.ptp(limits, axis=1)
    rng = np.random.default_rng(11)
    return rng.uniform(limits[:, 0] - beyond, limits[:, 1] + beyond, (count, len(limits)))


def equal_answers(robot: twin.Robot, count: int) -> None:
    """Assert that closed loops and inverse are equal bit for bit, and that the same states have no answer."""
    q = random_states(robot, count)
    by_processor = robot.loops.forward_many(q)
    with computing_on("gpu") as device:
        by_card = robot.loops.forward_many(q)
    assert device.name != PROCESSOR
    for name in ("Ts_base_tool", "states", "offset", "tilt", "margin"):
        np.testing.assert_array_equal(getattr(by_card, name), getattr(by_processor, name))
    kin = robot.kinematics()
    Ts = by_processor.Ts_base_tool[np.isfinite(by_processor.Ts_base_tool).all(axis=(1, 2))]
    if kin.closed_inverse:
        q = kin.inverse_many(Ts)
        with computing_on("gpu") as device:
            np.testing.assert_array_equal(kin.inverse_many(Ts), q)
        assert device.name != PROCESSOR
    if kin.closed_forward:
        Ts = kin.forward_many(q)
        with computing_on("gpu"):
            np.testing.assert_array_equal(kin.forward_many(q), Ts)


def test_states_of_a_robot(card):
    equal_answers(twin.load("davinci_psm"), 2000)


def test_many_poses_of_a_robot_are_computed_by_the_chosen_device(card):
    robot = twin.load("pa10")
    q = np.random.default_rng(5).uniform(-1.0, 1.0, (300, 7))
    Ts = robot.forward(q)
    answers = robot.inverse(Ts)
    assert not card.launches
    np.testing.assert_array_equal(robot.forward(q, device="gpu"), Ts)
    np.testing.assert_array_equal(robot.inverse(Ts, device="gpu"), answers)
    assert len(card.launches) >= 2
    with pytest.raises(TwinError, match="no compute device 'card'"):
        robot.forward(q, device="card")


@pytest.mark.slow
@pytest.mark.parametrize("name", one_of_a_kind())
def test_states_of_every_robot(name, card):
    equal_answers(twin.load(name), 5000)


def test_the_driver_computes_or_takes_the_arguments():
    """Without a GPU's driver, the library converts all arguments before it misses the driver."""
    driver = pytest.importorskip("cuda.bindings.driver", reason="the extra gpu is not installed")
    found, reason = gpu.found()
    if found is not None:
        x = np.arange(20_000.0).reshape(2, -1)
        y = np.full((1, 10_000), 3.0)
        with computing_on("gpu") as device:
            products, differences = product()(x, y)
        assert device.name == found.name
        np.testing.assert_array_equal(products, 3 * x)
        np.testing.assert_array_equal(differences, x[:1] - 3)
        return
    assert "the NVIDIA driver is missing" in reason
    card = object.__new__(gpu.CudaGpu)
    card._driver = driver
    card._loaded = {}
    card._context = driver.CUcontext()
    array = np.zeros(8)
    address = driver.CUdeviceptr(64)
    stream = driver.CUstream(8)
    function = driver.CUfunction(8)
    calls = [
        (driver.cuInit, 0),
        (driver.cuDeviceGet, 0),
        (driver.cuDevicePrimaryCtxRetain, driver.CUdevice(0)),
        (driver.cuDeviceGetName, 256, driver.CUdevice(0)),
        (
            driver.cuDeviceGetAttribute,
            driver.CUdevice_attribute.CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR,
            driver.CUdevice(0),
        ),
        (driver.cuModuleUnload, driver.CUmodule()),
        (driver.cuModuleLoadData, b".version 6.3\0"),
        (driver.cuModuleGetFunction, driver.CUmodule(), b"samples"),
    ]
    for call in calls:
        with pytest.raises(GpuError, match=MISSING):
            card._call("answer", *call)
    card._enter = lambda: None
    card._pinned = {array.ctypes.data: 64}
    for work in (
        card.free_bytes,
        card.stream,
        lambda: card.pinned(8),
        lambda: card.reserved(8),
        lambda: card.release((address,), (), ()),
        lambda: card.release((), (array,), ()),
        lambda: card.release((), (), (stream,)),
        lambda: card.copy_to(address, array, stream),
        lambda: card.copy_from(array, int(address) + 64, stream),
        lambda: card.launch(function, 4, 128, (10, address, 1, 2, address, 3, 4), stream),
        lambda: card.wait(stream),
    ):
        with pytest.raises(GpuError, match=MISSING):
            work()


def test_importing_twin_loads_nothing_of_it():
    code = "import sys, twin; print([m for m in sys.modules if m.startswith(('cuda', 'llvmlite', 'twin.core.gpu'))])"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.slow
def test_the_benchmark_says_that_there_is_no_gpu():
    found, reason = gpu.found()
    if found is not None:
        pytest.skip(f"there is a GPU, {found.name}")
    script = Path(__file__).parents[1] / "benchmarks/gpu.py"
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert f"NO GPU: {reason}. Nothing was measured." in done.stderr


@pytest.mark.nightly
def test_the_benchmark_can_be_rehearsed(tmp_path):
    script = Path(__file__).parents[1] / "benchmarks/gpu.py"
    command = [sys.executable, script, "--rehearse", "--out", tmp_path]
    subprocess.run(command, check=True, capture_output=True)
    found = json.loads((tmp_path / "gpu.json").read_text())
    assert all(row["met"] for row in found["same answers"].values())
    assert set(found["user's work"]) == {"workspace sils", "tolerance sher"}


def test_threads_that_call_first_at_once_share_the_lanes(card, monkeypatch):
    class Slow(gpu_kernel._Lanes):
        def __init__(self, card):
            time.sleep(0.05)
            super().__init__(card)

    monkeypatch.setattr(gpu_kernel, "_Lanes", Slow)
    with ThreadPoolExecutor(4) as pool:
        lanes = set(pool.map(gpu_kernel._lanes, [card] * 4))
    assert len(lanes) == 1
