"""Kernels on an NVIDIA GPU against the processor: same answers, states per second, and what a user waits for.

    python tests/benchmarks/gpu.py               all of it (`make bench-gpu`) -> bench-out/gpu.json
    python tests/benchmarks/gpu.py --rehearse    without a GPU: the same steps with few states, by the processor

The GPU is measured with the samples in its memory (copies excluded), and through the computer's memory (included).
A peer in the same run, if it is installed: Gauss-Newton in double precision by JAX, on the same card.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import twin
from twin.analysis.search import workspace
from twin.analysis.tolerance import Spread, tolerance
from twin.codegen.gpu_entry import ENTRY, THREADS
from twin.core import assets, gpu
from twin.core.compute_device import computing_on

SPEEDS = {"sils": 500e6, "sher": 700e6, "davinci_psm": 8e9}
"""{robot: loops per second that one H100 must reach, copies excluded}."""

SAME = 1e-12
"""Largest allowed difference of poses, m or rad, away from singularities of the loops."""

ROUNDS = 7


def states(robot: twin.Robot, count: int) -> np.ndarray:
    """Return random joint values (count, n): half near the rest pose, half over the whole range and beyond."""
    limits = np.where(np.isfinite(robot.mechanism.limits), robot.mechanism.limits, [-np.pi, np.pi])
    span = np.ptp(limits, axis=1)
    rng = np.random.default_rng(0)
    near = robot.loops.q + 0.1 * span * rng.uniform(-1, 1, (count // 2, len(span)))
    anywhere = limits[:, 0] - 0.1 * span + 1.2 * span * rng.uniform(0, 1, (count - count // 2, len(span)))
    return np.concatenate([near, anywhere])


def same_answers(robot: twin.Robot, count: int) -> dict[str, Any]:
    """Return how many states processor and GPU answer differently, and by how much their poses differ."""
    q = states(robot, count)
    with computing_on("cpu"):
        one = robot.loops.forward_many(q)
    with computing_on("gpu"):
        other = robot.loops.forward_many(q)
    lost = np.isnan(one.Ts_base_tool).any(axis=(1, 2))
    also = np.isnan(other.Ts_base_tool).any(axis=(1, 2))
    both = ~lost & ~also
    difference = np.abs(one.Ts_base_tool - other.Ts_base_tool)[both].max(axis=(1, 2), initial=0.0)
    # Beside a singularity, a residual of one rounding is a larger error of the pose.
    scaled = difference * np.minimum(1.0, one.margin[both])
    return {
        "states": count,
        "refused": int(lost.sum()),
        "refused by one only": int((lost != also).sum()),
        "largest difference": float(difference.max(initial=0.0)),
        "largest difference, times the margin to a singularity": float(scaled.max(initial=0.0)),
        "met": bool((lost == also).all() and scaled.max(initial=0.0) <= SAME),
    }


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
    kernel = robot.loops._cold.for_gpu
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
            robot.loops._cold(q)

    copied = median_seconds(through_the_computer)
    processor = median_seconds(lambda: robot.loops._cold(fewer)) * (count / fewer.shape[1])
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
        "tolerance sher": lambda: tolerance(sher, Spread(1e-5, 1e-5, 1e-6, 1e-5), samples=count // 10),
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


def by_jax(count: int) -> float | None:
    """Return the states of SILS per second that Gauss-Newton by JAX closes in double precision; None: not installed."""
    try:
        import jax
    except ModuleNotFoundError:
        print("  !! JAX LEFT OUT: it is not installed (pip install 'jax[cuda13]')")
        return None
    jax.config.update("jax_enable_x64", True)
    robot = twin.load("sils")
    close = jax_newton(robot.loops)
    q = jax.numpy.asarray(states(robot, count))
    return count / median_seconds(lambda: close(q).block_until_ready())


def jax_newton(loops: Any, steps: int = 8) -> Callable[..., Any]:
    """Return a function from q (k, n) to the loop unknowns (k, m): Gauss-Newton steps on the residual of the loops."""
    import casadi as ca
    import jax
    import jax.numpy as jnp

    e = loops.equations
    function = ca.Function("residual", [e.q, e.states], [ca.densify(e.residual)], {"cse": True})
    one = {ca.OP_SIN: jnp.sin, ca.OP_COS: jnp.cos, ca.OP_SQRT: jnp.sqrt, ca.OP_SQ: jnp.square, ca.OP_NEG: jnp.negative}
    two = {ca.OP_ADD: jnp.add, ca.OP_SUB: jnp.subtract, ca.OP_MUL: jnp.multiply, ca.OP_DIV: jnp.divide}

    def residual(q, x):
        values: dict[int, Any] = {}
        results = [0.0] * function.numel_out(0)
        for k in range(function.n_instructions()):
            op = function.instruction_id(k)
            sources = function.instruction_input(k)
            targets = function.instruction_output(k)
            if op == ca.OP_INPUT:
                values[targets[0]] = (q, x)[sources[0]][sources[1]]
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
        return jnp.stack([jnp.asarray(result) for result in results])

    start = jnp.asarray(np.concatenate(loops.home))

    def close(q):
        def step(_, x):
            J = jax.jacfwd(residual, argnums=1)(q, x)
            return x - jnp.linalg.lstsq(J, residual(q, x))[0]

        return jax.lax.fori_loop(0, steps, step, start)

    return jax.jit(jax.vmap(close))


def main() -> int:
    """Measure, print, and write; 1 if a figure is missed, 2 if there is no GPU."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rehearse", action="store_true", help="few states, by the processor: times mean nothing")
    parser.add_argument("--out", type=Path, default=Path("bench-out"), help="folder (default bench-out)")
    options = parser.parse_args()
    many = 1_000_000
    if options.rehearse:
        sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
        from made.processor_as_gpu import ProcessorAsGpu

        stand_in = ProcessorAsGpu()
        gpu.found = lambda: (stand_in, "")
        many = 1000
    card, reason = gpu.found()
    if card is None:
        print(f"NO GPU: {reason}. Nothing was measured.", file=sys.stderr)
        return 2
    print(f"{card.name}, {assets.names()}")
    found: dict[str, Any] = {"device": card.name, "same answers": {}, "speed": {}}
    for name in assets.names():
        found["same answers"][name] = same_answers(twin.load(name), many)
        print(name, json.dumps(found["same answers"][name]))
    for name in SPEEDS:
        found["speed"][name] = speeds(card, name, 20 * many)
        print(name, json.dumps(found["speed"][name]))
    if not options.rehearse:
        found["JAX, SILS per second"] = by_jax(many)
    found["user's work"] = users_work(100 * many if not options.rehearse else 10_000)
    print(json.dumps(found["user's work"]))
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "gpu.json").write_text(json.dumps(found, indent=2))
    print(options.out / "gpu.json")
    missed = [name for name, row in found["same answers"].items() if not row["met"]]
    missed += [name for name, row in found["speed"].items() if not row["met"]]
    return 1 if missed and not options.rehearse else 0


if __name__ == "__main__":
    sys.exit(main())
