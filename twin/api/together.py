"""Plan the motions of several robots of a scene at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from twin.api.robot import Progress, Robot, load, silent
from twin.core import assets
from twin.core.errors import ProtocolError, TwinError, unknown
from twin.core.spatial import Array

if TYPE_CHECKING:
    from twin.model.mechanism import Mechanism
    from twin.model.scene import Place
    from twin.planning.path import Path
    from twin.planning.planned_together import PlannedTogether
    from twin.planning.protocol import Limits, Protocol
    from twin.planning.timing import Timing
    from twin.reference.space import JointSpace

_SPEED, _RISE = 5.0, 20.0
"""Speed in joint ranges per s, and acceleration per speed in 1/s, of a joint for which the robot states no limit."""

_DT = 1e-3


class _Arm:
    """An arm with its joint values at the ends of its phases."""

    def __init__(self, place: Place, robot: Robot, protocol: Protocol) -> None:
        from twin.planning.following import placed
        from twin.planning.protocol.phases.free import Free
        from twin.reference import ReferenceModel

        self.place, self.name, self.protocol = place, place.name, protocol
        self.mechanism: Mechanism = robot.mechanism
        others = [p for p in protocol.phases if not isinstance(p, Free)]
        if others:
            raise ProtocolError(
                f"{self.name}: phase '{others[0].name}' ({others[0].type}) of protocol {protocol.name} follows a given "
                "path, which leaves no choice beside another arm; leave only phases joints, positioning, home and free"
            )
        home = ReferenceModel(self.mechanism).home().q
        names = tuple(j.name for j in self.mechanism.active)
        angles = tuple(j.is_angle for j in self.mechanism.active)
        self.q: list[Array] = []
        for name in (protocol.start, *(p.to for p in protocol.phases if isinstance(p, Free))):
            waypoint, where = protocol.waypoints[name], f"{protocol.name}: waypoint '{name}'"
            if waypoint.joints is None:
                raise ProtocolError(
                    f"{where} is a pose; to plan several arms at once, give joint values: joints = {{ ... }}"
                )
            self.q.append(placed(home, waypoint.joints, waypoint.angle_joints, names, angles, where))

    def ends(self, phase: int) -> tuple[Array, Array]:
        """Return joint values (n,) at the ends of a phase; after its last phase, the arm stays."""
        last = len(self.q) - 1
        return self.q[min(phase, last)], self.q[min(phase + 1, last)]

    def named(self, phase: int) -> str:
        phases = self.protocol.phases
        return phases[phase].name if phase < len(phases) else "at rest"


def plan_together(
    scene: str,
    arms: Mapping[str, tuple[Robot, Protocol]],
    clearance: float = 0.005,
    seed: int = 0,
    progress: Progress = silent,
    cancelled: Callable[[], bool] | None = None,
) -> PlannedTogether:
    """Return a common plan of several robots of a scene, by priority.

    The first phases of all protocols begin together and end together, then the second ones, and so on. The first arm
    goes around what is at rest; each further arm also goes around those before it while they move, and they may wait
    for it. If no path is found, the opposite order is tried. Limits of joints and of the tips are respected.

    Args:
        scene: name or path of the scene.
        arms: robot and protocol of each arm, by its name in the scene or of the robot, in the order of priority.
        clearance: minimum distance in m.
        seed: seed of the random searches.
        progress: called with a description and a fraction.
        cancelled: as of `twin.planning.around.around`.

    Raises:
        TwinError: the scene or a robot in it does not exist.
        ProtocolError: a protocol has other phases than those around obstacles, or no path was found.
    """
    from twin.model.scene import load_scene
    from twin.planning.protocol import avoiding

    if not 0 < clearance < float("inf"):
        raise ProtocolError(f"the clearance is {clearance:g} m; give more than 0")
    if (file := assets.scene_file(scene)) is None:
        raise TwinError(unknown("scene", scene, assets.scenes()))
    read, found = load_scene(file), []
    for name, (robot, protocol) in arms.items():
        taken = {a.name for a in found}
        place = next((p for k in ("name", "robot") for p in read.places if getattr(p, k) == name), None)
        if place is None or place.name in taken:
            left = ", ".join(p.name for p in read.places if p.name not in taken)
            raise TwinError(f"scene '{read.name}' has no {'further ' if place else ''}robot '{name}'; it has: {left}")
        found.append(_Arm(place, robot, avoiding(protocol, scene, clearance, seed)))
    if len(found) < 2:
        raise TwinError("to plan several arms at once, name at least two")
    reasons = []
    for order in (found, found[::-1]):
        try:
            return _Plan(read, order, clearance, seed, progress, cancelled).made()
        except ProtocolError as error:
            reasons.append(str(error))
    if reasons[0].startswith("at ") or reasons[0] == reasons[1]:
        raise ProtocolError(reasons[0])
    raise ProtocolError(f"{reasons[0]}. In the opposite order: {reasons[1]}")


class _Plan:
    """A plan with one order of the arms."""

    def __init__(self, read, arms: Sequence[_Arm], clearance, seed, progress, cancelled) -> None:
        self.read, self.arms, self.clearance = read, arms, clearance
        self.seed, self.progress, self.cancelled = seed, progress, cancelled
        self.spaces = [self._space(k) for k in range(1, len(arms) + 1)]

    def _space(self, count: int) -> JointSpace:
        """Return the space of the first arms; those after them are left out, all other robots are obstacles."""
        from twin.api.standing import obstacles
        from twin.model.joined import joined, owners
        from twin.reference import ReferenceModel
        from twin.reference.space import JointSpace

        names = [a.name for a in self.arms]
        parts = {a.name: (a.mechanism, a.place.T_world_base) for a in self.arms[:count]}
        around = lambda: obstacles(self.read, names, load)  # noqa: E731
        return JointSpace(lambda: ReferenceModel(joined(parts)), self.clearance, around=around, arms=owners(parts))

    def made(self) -> PlannedTogether:
        from twin.planning.planned_together import CommonPhase, PlannedTogether

        self._require_free_ends()
        t, rows, phases = np.zeros(1), [np.concatenate([a.q[0] for a in self.arms])[None]], []
        for phase in range(max(len(a.q) - 1 for a in self.arms)):
            path = self._path(phase)
            whole = self.spaces[-1]
            seen = whole.certify(path)
            timing = self._timed(path, phase)
            began = float(t[-1])
            t, rows = np.concatenate([t, began + timing.t[1:]]), [*rows, path(timing.s[1:])]
            name = " / ".join(a.named(phase) for a in self.arms)
            phases.append(CommonPhase(name, began, float(t[-1]), seen.proven, seen.found, seen.bodies))
        q, at = np.concatenate(rows), np.cumsum([0, *(len(a.q[0]) for a in self.arms)])
        joints = {a.name: [(j.name, j.is_angle) for j in a.mechanism.active] for a in self.arms}
        values = {a.name: q[:, i:j] for a, i, j in zip(self.arms, at, at[1:], strict=False)}
        return PlannedTogether(self.read.name, joints, [a.name for a in self.arms], t, values, phases)

    def _require_free_ends(self) -> None:
        """Raise an error if the arms collide at a waypoint, with each other or with the scene."""
        for phase in range(max(len(a.q) for a in self.arms)):
            q = np.concatenate([a.ends(phase)[0] for a in self.arms])
            if reason := self.spaces[-1].why(q):
                where = ", ".join(f"{a.name} at '{self._waypoint(a, phase)}'" for a in self.arms)
                raise ProtocolError(f"at {where}: {reason}. Move a waypoint, or lower the clearance")

    @staticmethod
    def _waypoint(arm: _Arm, phase: int) -> str:
        names = [arm.protocol.start, *(getattr(p, "to", "") for p in arm.protocol.phases)]
        return names[min(phase, len(names) - 1)]

    def _path(self, phase: int) -> Path:
        """Return the common path of all arms in a phase."""
        from twin.planning.around import around
        from twin.planning.together import beside

        out, before = None, []
        for arm, space in zip(self.arms, self.spaces, strict=True):
            start, goal = arm.ends(phase)
            label = f"{arm.name}: path around obstacles{' and ' + ', '.join(before) if before else ''}"
            more = {"seed": self.seed, "cancelled": self.cancelled, "progress": lambda f, t=label: self.progress(t, f)}
            try:
                out = around(space, start, goal, **more) if out is None else beside(space, out, start, goal, **more)
            except ProtocolError as error:
                moving = f" while {' and '.join(before)} {'move' if len(before) > 1 else 'moves'}" if before else ""
                raise ProtocolError(f"{arm.name}, phase '{arm.named(phase)}'{moving}: {error}") from error
            before.append(arm.name)
        assert out is not None
        return out

    def _timed(self, path: Path, phase: int) -> Timing:
        """Return the timing of a common path, within the limits of all joints and of all tips."""
        from twin.planning.timing import time_path

        joints = [j for a in self.arms for j in a.mechanism.active]
        ranges = np.ptp(self.spaces[-1].limits, axis=1)
        speed = np.array([j.max_speed or _SPEED * r for j, r in zip(joints, ranges, strict=True)])
        rise = np.array([j.max_acceleration or _RISE * v for j, v in zip(joints, speed, strict=True)])
        timing = time_path(path, speed, rise, dt=_DT)
        slower = self._excess(path, timing)
        return timing if slower <= 1 else time_path(path, speed / slower, rise / slower**2, dt=_DT)

    def _excess(self, path: Path, timing: Timing) -> float:
        """Return the factor by which a motion must be slowed down, so that all tips are within their limits."""
        from twin.core import spatial
        from twin.reference import ReferenceModel

        q, at, out = path(timing.s), 0, 1.0
        for arm in self.arms:
            n = len(arm.q[0])
            model = ReferenceModel(arm.mechanism)
            Ts = model.run(q[:, at : at + n], model.solve(q[0, at : at + n])).Ts_base_tool
            at += n
            limits: Limits = arm.protocol.limits["free"]
            v = np.diff(Ts[:, :3, 3], axis=0) / _DT
            w = spatial.log_so3(Ts[1:, :3, :3] @ np.swapaxes(Ts[:-1, :3, :3], 1, 2)) / _DT
            for rate, fast, most in (
                (v, limits.tip_speed, limits.tip_acceleration),
                (w, limits.rotation_speed, limits.rotation_acceleration),
            ):
                change = np.diff(rate, axis=0) / _DT
                out = max(out, np.linalg.norm(rate, axis=1).max(initial=0.0) / fast)
                out = max(out, float(np.sqrt(np.linalg.norm(change, axis=1).max(initial=0.0) / most)))
        return float(out)
