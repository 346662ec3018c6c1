"""Kernels on an NVIDIA GPU against the processor: same answers, states per second, and what a user waits for.

    python tests/benchmarks/gpu.py               all of it (`make bench-gpu`) -> bench-out/gpu.json
    python tests/benchmarks/gpu.py --rehearse    without a GPU: the same steps with few states, by the processor
    python tests/benchmarks/gpu.py --answers     the same answers only: a million states of each robot
    python tests/benchmarks/gpu.py --answers sils --blocks 0:3    one robot, three of ten parts

Without a GPU, the processor runs the text that is translated for the GPU (tests/made/processor_as_gpu.py).

The GPU is measured with the samples in its memory (copies excluded), and through the computer's memory (included).
Peers in the same run, if installed (`uv pip install "jax[cuda13]" mujoco-warp`), on the same card: Gauss-Newton
in double precision by JAX, and MuJoCo Warp, which steps the exported SILS in single precision. No peer is a reference.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import twin
from twin.analysis.error_propagation import Spread
from twin.analysis.tolerance import tolerance
from twin.analysis.workspace import workspace
from twin.codegen.gpu_entry import ENTRY, THREADS
from twin.core import assets, gpu
from twin.core.compute_device import computing_on

SPEEDS = {"sils": 500e6, "sher": 700e6, "davinci_psm": 8e9}
"""{robot: loops per second that one H100 must reach, copies excluded}."""

SAME = 1e-12
"""Largest allowed difference of poses and joint values, m or rad; none is expected."""

BLOCK = 100_000
"""Number of states that are compared at once."""

ROUNDS = 7

STEPS = 20
"""Number of steps of a physics engine in a round."""


def states(robot: twin.Robot, count: int, block: int = 0) -> np.ndarray:
    """Return random joint values (count, n): half near the rest pose, half over the whole range and beyond.

    `block` is the seed: blocks have other states.
    """
    limits = np.where(np.isfinite(robot.mechanism.limits), robot.mechanism.limits, [-np.pi, np.pi])
    span = np.ptp(limits, axis=1)
    rng = np.random.default_rng(block)
    near = robot.loops.q + 0.1 * span * rng.uniform(-1, 1, (count // 2, len(span)))
    anywhere = limits[:, 0] - 0.1 * span + 1.2 * span * rng.uniform(0, 1, (count - count // 2, len(span)))
    return np.concatenate([near, anywhere])


def same_answers(robot: twin.Robot, blocks: range, size: int = BLOCK) -> dict[str, Any]:
    """Return how many states processor and GPU answer differently, and by how much their answers differ.

    Compared are tool poses, loop unknowns, gaps and margins of closed loops from rest, with the walk for states that
    Newton's method does not find at once; and the closed-form inverse at the poses that are reached.
    """
    refused = 0
    one_only = 0
    inverses = 0
    largest = 0.0
    other_bits = 0
    kin = robot.kinematics() if robot.has_equations else None
    for block in blocks:
        q = states(robot, size, block)
        with computing_on("cpu"):
            one = robot.loops.forward_many(q)
        with computing_on("gpu"):
            other = robot.loops.forward_many(q)
        lost = np.isnan(one.Ts_base_tool).any(axis=(1, 2))
        also = np.isnan(other.Ts_base_tool).any(axis=(1, 2))
        refused += int(lost.sum())
        one_only += int((lost != also).sum())
        both = ~lost & ~also
        largest = max(largest, _difference(one.Ts_base_tool[both], other.Ts_base_tool[both]))
        for name in ("Ts_base_tool", "states", "offset", "tilt", "margin"):
            other_bits += _other_bits(getattr(one, name), getattr(other, name))
        if kin is None or not kin.closed_inverse:
            continue
        Ts = one.Ts_base_tool[~lost]
        with computing_on("cpu"):
            solved = kin.inverse_many(Ts)
        with computing_on("gpu"):
            again = kin.inverse_many(Ts)
        inverses += len(Ts)
        one_only += int((np.isnan(solved) != np.isnan(again)).any(axis=1).sum())
        finite = np.isfinite(solved) & np.isfinite(again)
        largest = max(largest, _difference(solved[finite], again[finite]))
        other_bits += _other_bits(solved, again)
    return {
        "states": size * len(blocks),
        "refused": refused,
        "inverses": inverses,
        "refused by one only": one_only,
        "largest difference": largest,
        "numbers with other bits": other_bits,
        "met": one_only == 0 and largest <= SAME,
    }


def _difference(one: np.ndarray, other: np.ndarray) -> float:
    """Return the largest difference of two arrays."""
    return float(np.abs(one - other).max(initial=0.0))


def _other_bits(one: np.ndarray, other: np.ndarray) -> int:
    """Return how many numbers of two arrays differ; NaN equals NaN."""
    return int(((one != other) & ~(np.isnan(one) & np.isnan(other))).sum())


def median_seconds(run: Callable[[], object]) -> float:
    """Return the median time of several runs in s, after one that is not counted."""
    run()
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def on_the_card(card: gpu.Gpu, robot: twin.Robot, count: int) -> float:
    """Return the time in s for closing the loops at `count` states from rest, with all numbers on the card."""
    kernel = robot.loops._kernel_from_rest.for_gpu
    assert kernel is not None
    q = np.ascontiguousarray(states(robot, count).T)
    stream = card.stream()
    pinned = card.pinned(q.size)
    pinned[:] = q.ravel()
    given = card.reserved(q.size)
    computed = card.reserved(count * kernel.outputs)
    card.copy_to(given, pinned, stream)
    card.wait(stream)
    function = card.function(kernel.text, ENTRY)
    arguments = (count, given, count, 1, computed, count, 1)

    def run() -> None:
        card.launch(function, math.ceil(count / THREADS), THREADS, arguments, stream)
        card.wait(stream)

    seconds = median_seconds(run)
    card.release((given, computed), (pinned,), (stream,))
    return seconds


def speeds(card: gpu.Gpu, name: str, count: int) -> dict[str, Any]:
    """Return states per second of closed loops from rest: on the card, with copies, and by the processor."""
    robot = twin.load(name)
    seconds = on_the_card(card, robot, count)
    q = np.ascontiguousarray(states(robot, count).T)
    fewer = np.ascontiguousarray(states(robot, count // 20).T)

    def through_the_computer() -> None:
        with computing_on("gpu"):
            robot.loops._kernel_from_rest(q)

    copied = median_seconds(through_the_computer)
    processor = median_seconds(lambda: robot.loops._kernel_from_rest(fewer)) * (count / fewer.shape[1])
    rate = count / seconds
    return {
        "states": count,
        "per second, on the card": rate,
        "per second, with copies": count / copied,
        "per second, processor": count / processor,
        "ratio, on the card": processor / seconds,
        "ratio, with copies": processor / copied,
        "bar": SPEEDS[name],
        "met": rate >= SPEEDS[name],
    }


def users_work(count: int) -> dict[str, Any]:
    """Return the seconds that a workspace and a tolerance take by the processor and by the GPU."""
    sils = twin.load("sils")
    sher = twin.load("sher")
    turns = 10
    work: dict[str, Callable[[], object]] = {
        "workspace sils": lambda: workspace(sils, count, tilt=0.2, turns=turns),
        "tolerance sher": lambda: tolerance(sher, Spread(1e-5, 1e-5, 1e-6, 1e-5), samples=count),
    }
    found: dict[str, Any] = {}
    for name, run in work.items():
        seconds = {}
        for device in ("cpu", "gpu"):
            with computing_on(device):
                start = time.perf_counter()
                run()
                seconds[device] = time.perf_counter() - start
        found[name] = {"samples": count, "seconds": seconds, "ratio": seconds["cpu"] / seconds["gpu"]}
    return found


def by_jax(count: int) -> dict[str, Any] | None:
    """Return the states of SILS per second that Gauss-Newton by JAX closes in double precision; None: not installed."""
    try:
        import jax
    except ModuleNotFoundError:
        print("  !! JAX LEFT OUT: it is not installed (uv pip install 'jax[cuda13]')")
        return None
    jax.config.update("jax_enable_x64", True)
    robot = twin.load("sils")
    close = jax_newton(robot.loops)
    given = states(robot, count)
    q = jax.numpy.asarray(given)
    solved = robot.loops.forward_many(given)
    reached = np.isfinite(solved.Ts_base_tool).all(axis=(1, 2))
    apart = np.abs(np.asarray(close(q)) - solved.states).max(axis=1)
    rate = count / median_seconds(lambda: close(q).block_until_ready())
    return {
        "device": str(q.device),
        "states": count,
        "per second": rate,
        "right, of those that twin reaches": f"{int((apart[reached] < 1e-9).sum())} of {int(reached.sum())}",
    }


def by_mujoco_warp(count: int) -> dict[str, Any] | None:
    """Return the steps of the exported SILS per second by MuJoCo Warp; None: not installed.

    A step is no closed state: single precision, loops held by soft constraints. The gap after some steps is stated.
    """
    try:
        import mujoco
        import mujoco_warp
        import warp
    except ModuleNotFoundError:
        print("  !! MUJOCO WARP LEFT OUT: it is not installed (uv pip install mujoco-warp)")
        return None
    with tempfile.TemporaryDirectory() as folder:
        twin.export("sils", to="mjcf", out=folder)
        (file,) = Path(folder).rglob("sils.xml")
        model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    there = mujoco_warp.put_model(model)
    worlds = mujoco_warp.put_data(model, data, nworld=count)

    def steps() -> None:
        for _ in range(STEPS):
            mujoco_warp.step(there, worlds)
        warp.synchronize()

    seconds = median_seconds(steps)
    mujoco_warp.get_data_into(data, model, worlds)
    mujoco.mj_forward(model, data)
    gaps = np.abs(data.efc_pos[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY])
    return {
        "device": str(warp.get_device()),
        "worlds": count,
        "steps per second": count * STEPS / seconds,
        "largest gap of a loop, m": float(gaps.max(initial=0.0)),
    }


def jax_newton(loops: Any, steps: int = 8) -> Callable[..., Any]:
    """Return a function from q (k, n) to the loop unknowns (k, m): Gauss-Newton steps on the residual of the loops.

    As in twin's own solver, a ball joint has three steps that turn it, so that its quaternion stays a rotation.
    """
    import casadi as ca
    import jax
    import jax.numpy as jnp

    e = loops.equations
    stepped = ca.vertcat(*[passive.stepped(passive.step) for passive in e.passive])
    residual = ca.substitute(e.residual, e.states, stepped)
    gap = in_jax(ca.Function("gap", [e.q, e.states, e.steps], [ca.densify(residual)], {"cse": True}))
    moved = in_jax(ca.Function("moved", [e.states, e.steps], [ca.densify(stepped)], {"cse": True}))
    start = jnp.asarray(np.concatenate(loops.home))
    still = jnp.zeros(e.steps.numel())

    def close(q):
        def step(_, x):
            J = jax.jacfwd(gap, argnums=2)(q, x, still)
            return moved(x, -jnp.linalg.lstsq(J, gap(q, x, still))[0])

        return jax.lax.fori_loop(0, steps, step, start)

    return jax.jit(jax.vmap(close))


def in_jax(function: Any) -> Callable[..., Any]:
    """Return a CasADi function with one result as a function of JAX, by its list of instructions."""
    import casadi as ca
    import jax.numpy as jnp

    one = {ca.OP_SIN: jnp.sin, ca.OP_COS: jnp.cos, ca.OP_SQRT: jnp.sqrt, ca.OP_SQ: jnp.square, ca.OP_NEG: jnp.negative}
    two = {ca.OP_ADD: jnp.add, ca.OP_SUB: jnp.subtract, ca.OP_MUL: jnp.multiply, ca.OP_DIV: jnp.divide}

    def computed(*vectors):
        values: dict[int, Any] = {}
        results: list[Any] = [0.0] * function.numel_out(0)
        for k in range(function.n_instructions()):
            op = function.instruction_id(k)
            sources = function.instruction_input(k)
            targets = function.instruction_output(k)
            if op == ca.OP_INPUT:
                values[targets[0]] = vectors[sources[0]][sources[1]]
            elif op == ca.OP_OUTPUT:
                results[targets[1]] = values[sources[0]]
            elif op == ca.OP_CONST:
                values[targets[0]] = function.instruction_constant(k)
            elif op == ca.OP_TWICE:
                values[targets[0]] = 2 * values[sources[0]]
            elif op == ca.OP_INV:
                values[targets[0]] = 1 / values[sources[0]]
            elif op in one:
                values[targets[0]] = one[op](values[sources[0]])
            else:
                values[targets[0]] = two[op](values[sources[0]], values[sources[1]])
        return jnp.stack([jnp.asarray(result, float) for result in results])

    return computed


def answers(names: Sequence[str], blocks: range, size: int) -> dict[str, Any]:
    """Return and print the comparison of the answers, by robot."""
    found = {}
    for name in names:
        start = time.perf_counter()
        found[name] = same_answers(twin.load(name), blocks, size)
        print(f"{name} ({time.perf_counter() - start:.0f} s)", json.dumps(found[name]), flush=True)
    return found


def processor_as_gpu() -> None:
    """Let the processor be the GPU: it runs the text that is translated for one."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    from made.processor_as_gpu import ProcessorAsGpu

    stand_in = ProcessorAsGpu()
    gpu.found = lambda: (stand_in, "")


def measured(card: gpu.Gpu, many: int, rehearse: bool) -> dict[str, Any]:
    """Return what `make bench-gpu` measures, with `many` states for the answers; print each part."""
    found: dict[str, Any] = {"device": card.name}
    found["same answers"] = answers(assets.names(), range(max(1, many // BLOCK)), min(many, BLOCK))
    found["speed"] = {}
    for name in SPEEDS:
        found["speed"][name] = speeds(card, name, 20 * many)
        print(name, json.dumps(found["speed"][name]), flush=True)
    worlds = 32 if rehearse else 8192
    for name, peer in (("JAX", by_jax(many)), ("MuJoCo Warp", by_mujoco_warp(worlds))):
        found[f"{name}, SILS"] = peer
        print(f"{name}, SILS", json.dumps(peer), flush=True)
    found["user's work"] = users_work(10_000 if rehearse else 100 * many)
    print(json.dumps(found["user's work"]))
    return found


def main() -> int:
    """Measure, print, and write; 1 if a figure is missed, 2 if there is no GPU."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rehearse", action="store_true", help="few states, by the processor: times mean nothing")
    parser.add_argument("--answers", nargs="*", metavar="ROBOT", help="only the same answers, by the processor")
    parser.add_argument(
        "--blocks", default="0:10", metavar="FIRST:LAST", help="with --answers: parts of 100 000 states"
    )
    parser.add_argument("--out", type=Path, default=Path("bench-out"), help="folder (default bench-out)")
    options = parser.parse_args()
    if options.answers is not None or options.rehearse:
        processor_as_gpu()
    card, reason = gpu.found()
    if card is None:
        print(f"NO GPU: {reason}. Nothing was measured.", file=sys.stderr)
        return 2
    print(f"{card.name}, {assets.names()}")
    if options.answers is not None:
        first, last = map(int, options.blocks.split(":"))
        compared = answers(options.answers or assets.names(), range(first, last), BLOCK)
        return int(not all(row["met"] for row in compared.values()))
    found = measured(card, 1000 if options.rehearse else 1_000_000, options.rehearse)
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "gpu.json").write_text(json.dumps(found, indent=2))
    print(options.out / "gpu.json")
    missed = [name for name, row in found["same answers"].items() if not row["met"]]
    missed += [name for name, row in found["speed"].items() if not row["met"]]
    return 1 if missed and not options.rehearse else 0


if __name__ == "__main__":
    sys.exit(main())
