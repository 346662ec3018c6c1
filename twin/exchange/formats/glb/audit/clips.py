"""Read the animations of a glTF file: link poses at the keys of each animation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from twin.core.json_types import JsonObject
from twin.exchange.audit import poses
from twin.exchange.audit.motion import Clip, check_quaternions, check_times
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import Measured, ReadError
from twin.exchange.formats.glb.audit.container import Gltf
from twin.exchange.formats.glb.audit.nodes import Node, local

PATHS = {"translation": 3, "rotation": 4, "scale": 3}
MODES = ("LINEAR", "STEP", "CUBICSPLINE")

MOST_POSES = 20_000_000
"""Maximum number of node poses in one clip, to limit memory."""


@dataclass(frozen=True)
class Channel:
    """An animated property of a node.

    Attributes:
        node: index of the node.
        path: the property: "translation", "rotation" or "scale".
        mode: interpolation: "LINEAR", "STEP" or "CUBICSPLINE".
        times: key times (k,) in s.
        values: values (k, n) at the keys.
        incoming, outgoing: tangents (k, n) at the keys; None except for CUBICSPLINE.
    """

    node: int
    path: str
    mode: str
    times: Array
    values: Array
    incoming: Array | None = None
    outgoing: Array | None = None

    def at(self, t: Array) -> Array:
        """Return values (j, n) at times t (j,) in s. Before the first and after the last key, they are constant."""
        x = np.clip(t, self.times[0], self.times[-1])
        i = np.clip(np.searchsorted(self.times, x, side="right") - 1, 0, max(len(self.times) - 2, 0))
        if len(self.times) == 1:
            return np.repeat(self.values, len(t), axis=0)
        h = self.times[i + 1] - self.times[i]
        u = (x - self.times[i]) / h
        a, b = self.values[i], self.values[i + 1]
        if self.mode == "STEP":
            return np.where((u >= 1)[:, None], b, a)
        if self.mode == "CUBICSPLINE" and self.incoming is not None and self.outgoing is not None:
            s, h = u[:, None], h[:, None]
            out = (2 * s**3 - 3 * s**2 + 1) * a + h * (s**3 - 2 * s**2 + s) * self.outgoing[i]
            return out + (-2 * s**3 + 3 * s**2) * b + h * (s**3 - s**2) * self.incoming[i + 1]
        if self.path == "rotation":
            return poses.slerp(a, b, u)
        return (1 - u)[:, None] * a + u[:, None] * b


class Clips:
    """The animations of one file, evaluated on its tree of nodes."""

    def __init__(self, file: Gltf, nodes: list[Node], order: list[int]) -> None:
        self._nodes, self._order, self._ledger = nodes, order, file.ledger
        self._clips: list[tuple[str, list[Channel]]] = []
        for i, spec in enumerate(file.items("animations")):
            name = str(spec.get("name") or f"animation {i}")
            self._clips.append((name, list(channels(file, spec, name))))
        self.animated = {c.node for _, clip in self._clips for c in clip}

    def world(self, moved: dict[int, dict[str, Array]]) -> list[Array]:
        """Return T_world_node (k, 4, 4) of every node, in the world of the file; (1, 4, 4) if the node does not move.

        `moved` contains the animated values: {index of the node: {property: values (k, n)}}.
        """
        out: list[Array] = [np.eye(4)[None]] * len(self._nodes)
        for i in self._order:
            node = self._nodes[i]
            T = local(node, moved.get(i, {}))
            out[i] = T if node.parent < 0 else out[node.parent] @ T
        return out

    def z_up(self, M: Array) -> Array:
        """Convert matrices (k, 4, 4) in the file's world (y up) to poses (k, 4, 4) in a world with z up."""
        T, _ = poses.split(M)
        return poses.pose(poses.R_Z_UP_Y_UP) @ T

    def read(self, shown: list[Node]) -> Iterator[Clip]:
        """Yield each clip of the file, with the poses of the nodes in `shown` at all key times of the clip."""
        for name, found in self._clips:
            usable = [c for c in found if len(c.times)]
            if not usable:
                text = f"clip '{name}' has no valid channel that moves, rotates or scales a node."
                self._ledger.add("gltf.empty_clip", "warning", text, name)
                continue
            times = np.unique(np.concatenate([c.times for c in usable]))
            if len(times) * len(self._nodes) > MOST_POSES:
                text = (
                    f"clip '{name}' has {len(times)} keys x {len(self._nodes)} nodes = "
                    f"{len(times) * len(self._nodes)} poses; the maximum is {MOST_POSES}"
                )
                raise ReadError(text, "gltf.size")
            self._tell_jumps(name, usable)
            middle = self._placed(usable, shown, (times[1:] + times[:-1]) / 2)
            yield Clip(name, times, self._placed(usable, shown, times), middle=middle)

    def _placed(self, channels: list[Channel], shown: list[Node], times: Array) -> dict[str, Array]:
        moved: dict[int, dict[str, Array]] = {}
        for c in channels:
            moved.setdefault(c.node, {})[c.path] = c.at(times)
        world = self.world(moved)
        return {n.name: np.broadcast_to(self.z_up(world[n.index]), (len(times), 4, 4)) for n in shown}

    def _tell_jumps(self, clip: str, channels: list[Channel]) -> None:
        """Report channels with STEP interpolation: their motion jumps from key to key."""
        jumping = [
            c for c in channels if c.mode == "STEP" and len(c.values) > 2 and np.ptp(c.values, axis=0).max() > 1e-6
        ]
        if jumping:
            node = self._nodes[jumping[0].node].label
            text = (
                f"clip '{clip}' jumps from key to key (STEP) in {len(jumping)} channels, for instance of node '{node}'."
            )
            self._ledger.add("gltf.jumps", "info", text, clip, suggestion="use LINEAR for a motion")


def channels(file: Gltf, spec: JsonObject, clip: str) -> Iterator[Channel]:
    """Yield the valid channels of an animation; report the faults of invalid channels."""
    samplers = spec.get("samplers", [])
    seen: set[tuple[int, str]] = set()
    timed: dict[bytes, bool] = {}
    for i, entry in enumerate(spec.get("channels", [])):
        target = entry.get("target", {})
        path, node = target.get("path"), target.get("node")
        if path not in PATHS or node is None:
            if path not in ("weights", "pointer"):
                fault = "has no node" if path in PATHS else f"has the path '{path}', which glTF does not define"
                file.ledger.wrong("gltf.channel", f"clip '{clip}', channel {i}: the target {fault}.", clip)
            continue
        file.item("nodes", node)
        where = str(file.item("nodes", node).get("name") or f"node {node}")
        if (node, path) in seen:
            text = f"clip '{clip}' animates {path} of '{where}' twice."
            file.ledger.wrong("gltf.channel", text, where)
            continue
        seen.add((node, path))
        which = entry.get("sampler")
        if isinstance(which, bool) or not isinstance(which, int) or not 0 <= which < len(samplers):
            raise ReadError(f"clip '{clip}', channel {i}: there is no sampler {which}", "gltf.reference")
        channel = _channel(file, samplers[which], clip, node, path, where, timed)
        if channel is not None:
            yield channel


def _channel(
    file: Gltf, sampler: JsonObject, clip: str, node: int, path: str, where: str, timed: dict[bytes, bool]
) -> Channel | None:
    ledger = file.ledger
    mode = sampler.get("interpolation", "LINEAR")
    spec = file.item("accessors", sampler.get("input"))
    times, values = file.accessor(sampler["input"]), file.accessor(sampler.get("output"))
    if not ("min" in spec and "max" in spec):
        text = f"clip '{clip}': the accessor of the key times lacks min and max, from which players take the duration."
        ledger.wrong("gltf.minmax", text, where)
    if mode not in MODES:
        ledger.wrong("gltf.channel", f"clip '{clip}': interpolation '{mode}' is unknown.", where)
        return None
    times = times[:, 0]
    if (key := times.tobytes()) not in timed:  # most channels of a clip share one array of times
        timed[key] = check_times(ledger, times, clip, "gltf")
    if not timed[key]:
        return None
    per_key = 3 if mode == "CUBICSPLINE" else 1
    if values.shape != (per_key * len(times), PATHS[path]):
        text = (
            f"clip '{clip}': {path} of '{where}' has {values.shape[0]} values of {values.shape[1]} numbers for "
            f"{len(times)} keys."
        )
        ledger.wrong("gltf.samples", text, where, size=Measured(float(len(values)), float(per_key * len(times))))
        return None
    if not np.all(np.isfinite(values)):
        return None  # reported when the accessor was read
    incoming = outgoing = None
    if mode == "CUBICSPLINE":
        incoming, values, outgoing = values[0::3], values[1::3], values[2::3]
    if path == "rotation":
        check_quaternions(ledger, values, times, where, "gltf", mode != "STEP", shorter=True)
    if path == "scale" and np.min(values) <= 0:
        text = f"clip '{clip}' scales '{where}' by {np.min(values):.4g}: a scale must be above 0."
        ledger.wrong("gltf.mirrored", text, where)
    return Channel(node, path, mode, times, values, incoming, outgoing)
