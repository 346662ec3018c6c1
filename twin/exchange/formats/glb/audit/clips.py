"""Read the animations of a glTF file: link poses at the keys of each animation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from twin.core.json_types import JsonObject
from twin.exchange.audit import poses
from twin.exchange.audit.clip_checks import check_quaternions, check_times
from twin.exchange.audit.file_content import FileClip
from twin.exchange.audit.ledger import Ledger, Measured, ReadError
from twin.exchange.audit.poses import Array
from twin.exchange.formats.glb.audit.container import Gltf, is_index
from twin.exchange.formats.glb.audit.nodes import Node, local_matrices

PROPERTY_WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}
"""Animated properties of a node, and the count of numbers of a value."""

INTERPOLATIONS = ("LINEAR", "STEP", "CUBICSPLINE")

_VALUE_ROUNDING = 1e-6
"""Largest change of a property, in m or components of a quaternion, that counts as a rounding error."""

_SCALE_ROUNDING = 1e-4
"""Largest change of the scale of a link in a clip that counts as a rounding error."""

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
        if len(self.times) == 1:
            return np.repeat(self.values, len(t), axis=0)
        inside = np.clip(t, self.times[0], self.times[-1])
        # The last key belongs to the interval before it.
        before = np.clip(np.searchsorted(self.times, inside, side="right") - 1, 0, len(self.times) - 2)
        length = self.times[before + 1] - self.times[before]
        fraction = (inside - self.times[before]) / length
        value_before = self.values[before]
        value_after = self.values[before + 1]
        if self.mode == "STEP":
            return np.where((fraction >= 1)[:, None], value_after, value_before)
        if self.mode == "CUBICSPLINE" and self.incoming is not None and self.outgoing is not None:
            return _hermite(
                value_before,
                self.outgoing[before],
                value_after,
                self.incoming[before + 1],
                fraction[:, None],
                length[:, None],
            )
        if self.path == "rotation":
            return poses.slerp(value_before, value_after, fraction)
        return (1 - fraction)[:, None] * value_before + fraction[:, None] * value_after

    @property
    def jumps(self) -> bool:
        """Whether the property changes, and only at the keys."""
        if self.mode != "STEP" or len(self.values) <= 2:  # with two keys, the value changes only at the end
            return False
        return bool(np.ptp(self.values, axis=0).max() > _VALUE_ROUNDING)


def _hermite(start_value: Array, outgoing: Array, end_value: Array, incoming: Array, s: Array, length: Array) -> Array:
    """Return cubic Hermite interpolation at fractions s of intervals, as in appendix C of the glTF specification.

    The values at the ends are `start_value` and `end_value`, the tangents `outgoing` and `incoming`. All arguments are
    (j, n) or (j, 1).
    """
    start = (2 * s**3 - 3 * s**2 + 1) * start_value + length * (s**3 - 2 * s**2 + s) * outgoing
    return start + (-2 * s**3 + 3 * s**2) * end_value + length * (s**3 - s**2) * incoming


class Clips:
    """The animations of one file, evaluated on its tree of nodes."""

    def __init__(self, file: Gltf, nodes: list[Node], order: list[int]) -> None:
        self._nodes = nodes
        self._order = order
        self._ledger = file.ledger
        self._clips: list[tuple[str, list[Channel]]] = []
        self.animated: set[int] = set()
        for number, spec in enumerate(file.items("animations")):
            name = str(spec.get("name") or f"animation {number}")
            clip_channels = list(channels(file, spec, name))
            self._clips.append((name, clip_channels))
            for channel in clip_channels:
                self.animated.add(channel.node)

    def world(self, animated_values: dict[int, dict[str, Array]]) -> list[Array]:
        """Return T_world_node (k, 4, 4) of every node, in the world of the file; (1, 4, 4) if the node does not move.

        `animated_values` is {index of the node: {property: values (k, n)}}.
        """
        world_matrices: list[Array] = [np.eye(4)[None]] * len(self._nodes)
        for index in self._order:
            node = self._nodes[index]
            T = local_matrices(node, animated_values.get(index, {}))
            world_matrices[index] = T if node.parent < 0 else world_matrices[node.parent] @ T
        return world_matrices

    def z_up(self, matrices: Array) -> Array:
        """Convert matrices (k, 4, 4) in the file's world (y up) to poses (k, 4, 4) in a world with z up."""
        T, _ = poses.split(matrices)
        return poses.pose(poses.R_Z_UP_Y_UP) @ T

    def read(self, shown_nodes: list[Node]) -> Iterator[FileClip]:
        """Yield each clip of the file, with the poses of the nodes `shown_nodes` at all key times of the clip."""
        for name, clip_channels in self._clips:
            usable = [channel for channel in clip_channels if len(channel.times)]
            if not usable:
                text = f"clip '{name}' has no valid channel that moves, rotates or scales a node."
                self._ledger.add("gltf.empty_clip", "warning", text, name)
                continue
            # Channels may have key times of their own; poses are needed where any of them has a key.
            key_times = [channel.times for channel in usable]
            times = np.unique(np.concatenate(key_times))
            count = len(times) * len(self._nodes)
            if count > MOST_POSES:
                text = (
                    f"clip '{name}' has {len(times)} keys x {len(self._nodes)} nodes = {count} poses; the maximum is "
                    f"{MOST_POSES}"
                )
                raise ReadError(text, "gltf.size")
            self._report_jumps(name, usable)
            # Between keys, files of different formats may be interpolated differently.
            halfway = (times[1:] + times[:-1]) / 2
            middle = self._poses_at(usable, shown_nodes, halfway)
            yield FileClip(name, times, self._poses_at(usable, shown_nodes, times), middle=middle)

    def _poses_at(self, channels: list[Channel], shown_nodes: list[Node], times: Array) -> dict[str, Array]:
        """Return {node: T_world_node (k, 4, 4)} of the nodes `shown_nodes` at times (k,) in s, in a world with z up."""
        animated_values: dict[int, dict[str, Array]] = {}
        for channel in channels:
            animated_values.setdefault(channel.node, {})[channel.path] = channel.at(times)
        world = self.world(animated_values)
        link_poses = {}
        for node in shown_nodes:
            link_poses[node.name] = np.broadcast_to(self.z_up(world[node.index]), (len(times), 4, 4))
        return link_poses

    def _report_jumps(self, clip: str, channels: list[Channel]) -> None:
        """Report channels with STEP interpolation: their motion jumps from key to key."""
        jumping = [channel for channel in channels if channel.jumps]
        if jumping:
            node = self._nodes[jumping[0].node].label
            text = (
                f"clip '{clip}' jumps from key to key (STEP) in {len(jumping)} channels, for instance of node '{node}'."
            )
            self._ledger.add("gltf.jumps", "info", text, clip, suggestion="use LINEAR for a motion")


def channels(file: Gltf, spec: JsonObject, clip: str) -> Iterator[Channel]:
    """Yield the valid channels of an animation; report the faults of invalid channels."""
    samplers = spec.get("samplers", [])
    animated: set[tuple[int, str]] = set()
    usable_times: dict[bytes, bool] = {}
    for number, entry in enumerate(spec.get("channels", [])):
        target = entry.get("target", {})
        path = target.get("path")
        node = target.get("node")
        if path in ("weights", "pointer"):  # of morph targets, and of an extension: they move no link
            continue
        if path not in PROPERTY_WIDTHS:
            text = f"clip '{clip}', channel {number}: the target has the path '{path}', which glTF does not define."
            file.ledger.wrong("gltf.channel", text, clip)
            continue
        if node is None:
            file.ledger.wrong("gltf.channel", f"clip '{clip}', channel {number}: the target has no node.", clip)
            continue
        label = str(file.item("nodes", node).get("name") or f"node {node}")
        if (node, path) in animated:
            file.ledger.wrong("gltf.channel", f"clip '{clip}' animates {path} of '{label}' twice.", label)
            continue
        animated.add((node, path))
        index = entry.get("sampler")
        if not is_index(index, len(samplers)):
            raise ReadError(f"clip '{clip}', channel {number}: there is no sampler {index}", "gltf.reference")
        reader = _ChannelReader(file, clip, node, path, label, usable_times)
        channel = reader.read(samplers[index])
        if channel is not None:
            yield channel


@dataclass(frozen=True)
class _ChannelReader:
    """Reader of a channel: property `path` of a node, which is named `label` in reports.

    `usable_times` collects for all channels of a clip whether their key times can be used: most share one array.
    """

    file: Gltf
    clip: str
    node: int
    path: str
    label: str
    usable_times: dict[bytes, bool]

    def read(self, sampler: JsonObject) -> Channel | None:
        """Return the channel with the keys of a sampler; None, with findings, if they cannot be used."""
        ledger = self.file.ledger
        mode = sampler.get("interpolation", "LINEAR")
        spec = self.file.item("accessors", sampler.get("input"))
        times = self.file.accessor(sampler["input"])[:, 0]
        values = self.file.accessor(sampler.get("output"))
        if not ("min" in spec and "max" in spec):
            text = (
                f"clip '{self.clip}': the accessor of the key times lacks min and max, from which players take the "
                "duration."
            )
            ledger.wrong("gltf.minmax", text, self.label)
        if mode not in INTERPOLATIONS:
            ledger.wrong("gltf.channel", f"clip '{self.clip}': interpolation '{mode}' is unknown.", self.label)
            return None
        if not self._has_usable_times(times, ledger):
            return None
        # A key of a spline is three values: incoming tangent, value, outgoing tangent.
        values_per_key = 3 if mode == "CUBICSPLINE" else 1
        expected = values_per_key * len(times)
        if values.shape != (expected, PROPERTY_WIDTHS[self.path]):
            count, width = values.shape
            text = (
                f"clip '{self.clip}': {self.path} of '{self.label}' has {count} values of {width} numbers for "
                f"{len(times)} keys; interpolation {mode} needs {expected} values of {PROPERTY_WIDTHS[self.path]}: "
                f"{values_per_key} for each key."
            )
            ledger.wrong("gltf.samples", text, self.label, size=Measured(float(count), float(expected)))
            return None
        if not np.all(np.isfinite(values)):
            return None  # reported when the accessor was read
        incoming = None
        outgoing = None
        if mode == "CUBICSPLINE":
            incoming = values[0::3]
            outgoing = values[2::3]
            values = values[1::3]
        if self.path == "rotation":
            check_quaternions(ledger, values, times, self.label, "gltf", mode != "STEP", takes_shorter=True)
        if self.path == "scale" and np.ptp(values, axis=0).max() > _SCALE_ROUNDING and self._is_link():
            text = f"clip '{self.clip}' changes the scale of link '{self.label}': links are rigid."
            ledger.wrong("gltf.scale", text, self.label)
        if self.path == "scale" and np.min(values) <= 0:
            text = f"clip '{self.clip}' scales '{self.label}' by {np.min(values):.4g}: a scale must be above 0."
            ledger.wrong("gltf.mirrored", text, self.label)
        return Channel(self.node, self.path, mode, times, values, incoming, outgoing)

    def _is_link(self) -> bool:
        extras = self.file.item("nodes", self.node).get("extras")
        return isinstance(extras, dict) and bool(extras.get("link"))

    def _has_usable_times(self, times: Array, ledger: Ledger) -> bool:
        """Return whether key times can be used; report faults of each array of times once."""
        key = times.tobytes()
        if key not in self.usable_times:
            self.usable_times[key] = check_times(ledger, times, self.clip, "gltf")
        return self.usable_times[key]
