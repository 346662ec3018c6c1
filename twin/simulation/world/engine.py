"""The World: each tick runs devices, controllers and plants, with hazards between them, and records all signals."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import WorldError, unknown
from twin.core.spatial import Array
from twin.model.deformable import Deformable
from twin.model.mechanism import Mechanism
from twin.model.movable import Movable
from twin.reference import Assembly, ReferenceModel
from twin.simulation.frame import WorldFrame
from twin.simulation.world.block import Block, Hazard
from twin.simulation.world.recording import Recording
from twin.simulation.world.signal_kinds import OBJECT_POSE, ROBOT_Q
from twin.simulation.world.signals import Signals, put


@dataclass(frozen=True)
class Placed:
    """A mechanism and its pose T_world_base (4, 4); for a robot, `<name>.q` has the values (n,) of the active joints.

    `links` returns T_base_body (4, 4) of each body at active joint values (n,). The default is the reference model.
    In a World that is drawn many times per second, a compiled function saves more time than its compilation takes.
    """

    name: str
    mechanism: Mechanism
    T_world_base: Array = field(default_factory=lambda: np.eye(4))
    links: Callable[[Array], Mapping[str, Array]] | None = None


class _BlockRun(NamedTuple):
    """A block with the ticks and the time in s between its steps, and the memory and hazards of its signals.

    The World unpacks this tuple in each tick, which is faster than reading attributes.
    """

    block: Block
    ticks_per_step: int
    dt: float
    memory: Mapping[str, Array]
    hazards: Mapping[str, Sequence[Hazard]]


class World:
    """Robots, props, deformables and movable objects, with the blocks that move them.

    Equal blocks with equal seeds give equal bytes, independent of the wall clock. Pacing, display and network are
    outside the World. A tick runs all devices, then the controllers, then the plants, in the given order; each hazard
    acts after the block that writes its signal. The plants of contact and tissue run after those of the robots.

    Attributes:
        dt: duration of one tick in s.
        tick: number of completed ticks.
        signals: the current signals.
        ended: whether the input of a device has ended.
        deformables: the deformables.
    """

    def __init__(
        self,
        *,
        robots: Sequence[Placed] = (),
        props: Sequence[Placed] = (),
        deformables: Sequence[Deformable] = (),
        objects: Sequence[Movable] = (),
        devices: Sequence[Block] = (),
        controllers: Sequence[Block] = (),
        plants: Sequence[Block] = (),
        hazards: Sequence[Hazard] = (),
        dt: float = 1e-3,
        records: bool = True,
    ) -> None:
        """Connect the blocks; without `records`, no ticks are stored, so that long sessions need no memory.

        Raises:
            WorldError: two robots, props, deformables or objects have the same name, two blocks write the same signal,
                a robot or an object has no plant, the signal of a hazard does not exist, or a period is not a multiple
                of dt.
        """
        if not 0 < dt < math.inf:
            raise WorldError(f"dt is {dt:g} s; it must be above 0 and finite")
        self.dt = dt
        self.tick = 0
        self.ended = False
        self._robots = tuple(robots)
        self._props = tuple(props)
        self.deformables = tuple(deformables)
        self._objects = tuple(objects)
        _require_distinct([item.name for item in (*robots, *props, *deformables, *objects)])
        blocks = (*devices, *controllers, *plants)
        initial = _initial_values(blocks, hazards)
        self.signals = Signals(dict(sorted(initial.items())))  # order of a row: independent of the order of blocks
        self._devices: list[_BlockRun] = []
        for block in devices:
            self._devices.append(self._block_run(block, hazards))
        self._acting: list[_BlockRun] = []
        for block in (*controllers, *plants):
            self._acting.append(self._block_run(block, hazards))
        for robot in robots:
            self._require_plant(ROBOT_Q.of(robot.name), len(robot.mechanism.active), f"robot '{robot.name}'")
        for deformable in deformables:
            self._require_plant(deformable.signal, deformable.size, f"'{deformable.name}'")
            self._require_owner(deformable)
        for item in objects:
            self._require_plant(OBJECT_POSE.of(item.name), 16, f"object '{item.name}'")
        for run in (*self._devices, *self._acting):
            run.block.attach(self.signals, run.memory)
        self._rows: list[Array] = []
        self._records = records
        self._assemblies: dict[str, tuple[ReferenceModel, Assembly | None]] = {}

    def _block_run(self, block: Block, hazards: Iterable[Hazard]) -> _BlockRun:
        ticks_per_step = 0
        if math.isfinite(block.period):
            ticks_per_step = round(block.period / self.dt)
        # A period is a decimal number, so its quotient by dt is whole only up to rounding.
        is_whole = abs(ticks_per_step * self.dt - block.period) <= 1e-9 * self.dt  # false for NaN
        if not is_whole or block.period < 0:
            name = type(block).__name__
            raise WorldError(f"{name} steps every {block.period:g} s, which is not a multiple of {self.dt:g} s")
        ticks_per_step = max(ticks_per_step, 1)
        changes: dict[str, list[Hazard]] = {}
        memory = {}
        for name in block.outputs:
            changing = []
            for hazard in hazards:
                if hazard.signal == name:
                    changing.append(hazard)
            if changing:
                changes[name] = changing
                # The block writes beside the signal; `_change` puts the changed value into the signal.
                memory[name] = self.signals.view(f"{name}.written")
            else:
                memory[name] = self.signals.view(name)
        return _BlockRun(block, ticks_per_step, ticks_per_step * self.dt, memory, changes)

    def _require_plant(self, signal: str, size: int, whose: str) -> None:
        """Raise `WorldError` unless a block writes a signal with this number of values; `whose` names its owner."""
        if signal not in self.signals:
            raise WorldError(f"{whose} has no plant: no block writes '{signal}'")
        written = self.signals.sizes[signal]
        if written != size:
            raise WorldError(f"{whose} needs {size} numbers in '{signal}'; its plant writes {written}")

    def _require_owner(self, deformable: Deformable) -> None:
        """Raise `WorldError` unless the body to which a deformable is pinned is in this World."""
        owner = deformable.owner
        if not owner:
            return
        mechanisms = {placed.name: placed.mechanism for placed in (*self._robots, *self._props)}
        if owner not in mechanisms:
            raise WorldError(f"'{deformable.name}': {unknown('robot or prop', owner, mechanisms)}")
        bodies = [body.name for body in mechanisms[owner].bodies]
        if deformable.body not in bodies:
            raise WorldError(f"'{deformable.name}': {unknown(f'body of {owner}', deformable.body, bodies)}")

    @property
    def t(self) -> float:
        """Start of the next tick in s."""
        return self.tick * self.dt

    def step(self, ticks: int = 1) -> bool:
        """Run `ticks` ticks; return False if the input of a device ended before the last tick.

        Raises:
            WorldError: a block reads a missing signal, writes a signal of another block, or writes a number that is not
                finite.
        """
        signals = self.signals
        for _ in range(ticks):
            if self.ended:
                return False
            tick = self.tick
            t = self.t
            # No device sees the output of another device in this tick; if one has ended, no signal has changed yet.
            inputs: list[Mapping[str, ArrayLike]] = []
            for block, ticks_per_step, dt, *_ in self._devices:
                values = {} if tick % ticks_per_step else block.step(signals, t, dt)
                if values is None:
                    self.ended = True
                else:
                    inputs.append(values)
            if self.ended:
                return False
            for (block, _, _, memory, hazards), out in zip(self._devices, inputs, strict=True):
                if out:
                    _write(block, out, memory)
                if hazards:
                    self._change(memory, hazards, t)
            for block, ticks_per_step, dt, memory, hazards in self._acting:
                if (ticks_per_step == 1 or tick % ticks_per_step == 0) and (out := block.step(signals, t, dt)):
                    _write(block, out, memory)
                if hazards:
                    self._change(memory, hazards, t)
            signals.check(t)
            if self._records:
                self._rows.append(signals.row.copy())
            self.tick += 1
        return True

    def run(self) -> Recording:
        """Run until the input of a device ends; return the recording.

        Raises:
            WorldError: there is no device.
        """
        if not self._devices:
            raise WorldError("this World has no device whose input ends; use step(ticks)")
        while self.step():
            pass
        return self.recording()

    def recording(self) -> Recording:
        """Return the recording of all ticks so far."""
        sizes = self.signals.sizes
        # A World without ticks has no rows, but as many columns as one with ticks.
        rows = np.array(self._rows, float).reshape(-1, sum(sizes.values()))
        return Recording(self.dt, dict(sizes), rows)

    def frame(self) -> WorldFrame:
        """Return the link poses and vertices at the current time; the World does not change."""
        poses = self.link_poses()
        return WorldFrame(self.t, poses, self._fields(poses))

    def fields(self) -> dict[str, Array]:
        """Return {name of a deformable: vertices (n, 3) in m in the World}; faster than `frame`."""
        # only the poses that are needed: those of a robot with loops take most of the time
        owners = [deformable.owner for deformable in self.deformables]
        poses = {}
        for placed in (*self._robots, *self._props):
            if placed.name in owners:
                poses[placed.name] = self._poses(placed)
        return self._fields(poses)

    def _fields(self, poses: Mapping[str, Mapping[str, Array]]) -> dict[str, Array]:
        fields = {}
        for deformable in self.deformables:
            vertices = deformable.vertices(self.signals[deformable.signal])
            T_world_owner = np.eye(4)  # a deformable without owner has its vertices in the World
            if deformable.owner:
                T_world_owner = poses[deformable.owner][deformable.body]
            fields[deformable.name] = vertices @ T_world_owner[:3, :3].T + T_world_owner[:3, 3]
        return fields

    def link_poses(self) -> dict[str, dict[str, Array]]:
        """Return {robot, prop or object: {link: T_world_link (4, 4)}} at the current time, as part of `frame()`."""
        poses = {}
        for placed in (*self._robots, *self._props):
            poses[placed.name] = self._poses(placed)
        for item in self._objects:
            T_world_object = self.signals[OBJECT_POSE.of(item.name)].reshape(4, 4)
            poses[item.name] = {item.name: T_world_object}
        return poses

    def _poses(self, placed: Placed) -> dict[str, Array]:
        signal = ROBOT_Q.of(placed.name)
        if placed.links is not None:
            links = placed.links(self.signals[signal])
        else:
            links = self._assembly(placed, signal).link_poses
        poses = {}
        for name, T_base_link in links.items():
            poses[name] = placed.T_world_base @ T_base_link
        return poses

    def _assembly(self, placed: Placed, signal: str) -> Assembly:
        """Return the reference model's solution at the current joint values; loops are solved from the last one."""
        model, last = self._assemblies.get(placed.name) or (ReferenceModel(placed.mechanism), None)
        if signal in self.signals:
            q = self.signals[signal]
            if last is None or not np.array_equal(last.q, q):
                last = model.solve(q, last)
        elif last is None:
            last = model.home()  # a prop does not move
        self._assemblies[placed.name] = model, last
        return last

    def _change(self, memory: Mapping[str, Array], changes: Mapping[str, Sequence[Hazard]], t: float) -> None:
        for name, hazards in changes.items():
            value = memory[name].copy()
            for hazard in hazards:
                value = np.asarray(hazard.change(t, value), float)
            put(self.signals.view(name), name, value)


def _write(block: Block, out: Mapping[str, ArrayLike], memory: Mapping[str, Array]) -> None:
    for name, value in out.items():
        view = memory.get(name)
        if view is None:
            raise WorldError(f"{type(block).__name__} writes '{name}', which is not among its outputs")
        if type(value) is np.ndarray and value.shape == view.shape:
            view[...] = value  # the usual case, without the time of a call
        else:
            put(view, name, value)


def _initial_values(blocks: Iterable[Block], hazards: Iterable[Hazard]) -> dict[str, ArrayLike]:
    """Return the initial values of all signals; a signal with hazards has a second one, which its block writes."""
    blocks = tuple(blocks)
    written: list[str] = []
    for block in blocks:
        written += block.outputs
    writers = _require_distinct(written)
    initial: dict[str, ArrayLike] = {}
    for block in blocks:
        initial |= block.outputs
    for hazard in hazards:
        if hazard.signal not in writers:
            raise WorldError(unknown("signal", hazard.signal, writers))
        initial[f"{hazard.signal}.written"] = initial[hazard.signal]
    return initial


def _require_distinct(names: Iterable[str]) -> set[str]:
    """Return the names; raise `WorldError` if one is used twice."""
    distinct_names: set[str] = set()
    for name in names:
        if name in distinct_names:
            raise WorldError(f"'{name}' is used twice in one World; rename one")
        distinct_names.add(name)
    return distinct_names
