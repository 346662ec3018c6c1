"""Draw a session at a console: paths and speeds of the tips, and states of hands and pedals over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.api.console_session import ConsoleSession
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.model.task import goal_of, required_goal
from twin.simulation import console_scene
from twin.simulation.console_scene import PEDALS
from twin.simulation.controllers.trainer_states import TrainerPhase
from twin.simulation.session import movement
from twin.simulation.tasks.align.camera_task import AlignMeasures
from twin.simulation.tasks.align.play import AlignOutcome
from twin.simulation.tasks.align.task import Alignment
from twin.simulation.tasks.guide.play import GuideOutcome
from twin.simulation.tasks.guide.task import GuideTable
from twin.simulation.tasks.target.play import TargetOutcome
from twin.simulation.tasks.target.task import Targets
from twin.simulation.tasks.transfer.play import BoardOutcome
from twin.simulation.tasks.transfer.task import Transfers
from twin.simulation.world.signal_kinds import (
    DEVICE_CAMERA,
    DEVICE_CLUTCH,
    DEVICE_SILENT,
    HAND_GRIP,
    OBJECT_HOLDER,
    OBJECT_POSE,
    OBJECT_RUBS,
    ROBOT_FOLLOWS,
    ROBOT_MEETS,
    ROBOT_TOUCHES,
)
from twin.ui.report.plot_data import thinned_curve
from twin.ui.report.style import GRID, INK, NEAR, PALETTE, WIDTH, styled, titled_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_VIEWS = (("from above", 0, 1), ("from the feet", 0, 2))
"""(Title, horizontal axis, vertical axis) of each view of the paths; an axis is the index of an axis of the World."""

_MAX_CURVE_POINTS = 2000
"""Maximum number of points of a path and of a curve, because the page contains all points."""


@styled()
def figure(session: ConsoleSession) -> Figure:
    """Return a figure of tip paths and targets in two views, speeds of the tips, and states of pedals and grippers.

    In a camera task, the picture and the angle in the picture replace the two views. With machines, the deviation of
    the machines from their models replaces the second view.
    """
    table = console_scene.console_of(session.scene)
    arms = []
    longest = 0
    for hand in table.hands:
        for name in getattr(table, hand):
            arms.append((hand, name))
            longest = max(longest, len(name))
    rows = _rows(session, arms)
    # in inches; each hand has one more band, for its gripper
    bands = 0.24 * (len(rows) + len(table.hands))
    speeds = 1.6
    foot = 0.5
    base = foot + bands + speeds + 0.75
    height = 5.9 + bands
    tall = height - base - 0.8
    drawing = titled_figure(
        f"{session.scene.name}: session of {session.run.duration:.1f} s, {operator_text(session.seed)}", height
    )
    # in inches: space for the names of the bands; a name of an arm with 8 letters or more needs the larger one
    name_space = 1.2 if longest < 8 else 1.5
    x = name_space / WIDTH
    wide = (WIDTH - name_space - 0.25) / WIDTH
    low = drawing.add_axes((x, foot / height, wide, bands / height))
    middle = drawing.add_axes((x, (foot + bands + 0.2) / height, wide, speeds / height), sharex=low)
    for i in range(len(_VIEWS)):
        place = (x + i * (wide / 2 + 0.02), base / height, wide / 2 - 0.06, tall / height)
        ax = drawing.add_axes(place)
        _draw_view(ax, i, session, arms)
        ax.grid(True, color=GRID)
        ax.tick_params(length=2.5)
    for i, (hand, name) in enumerate(arms):
        drawing.text(0.012 + 0.14 * i, 1 - 0.5 / height, f"{hand}: {name}", color=PALETTE[i], fontsize=9, va="center")
    _draw_speeds(middle, session, arms)
    _draw_bands(low, session, arms, rows)
    return drawing


def operator_text(seed: int | None) -> str:
    """Return who operated in a session, by the seed of the simulated surgeon; None: a person."""
    if seed is None:
        return "a person"
    return f"simulated surgeon, seed {seed}"


def _draw_view(ax: Axes, view: int, session: ConsoleSession, arms: list[tuple[str, str]]) -> None:
    """Draw the upper left (i = 0) or upper right (i = 1) panel."""
    if session.training and view == 1:
        _draw_deviation(ax, session, arms)
        return
    outcome = session.outcome
    if not isinstance(outcome, AlignOutcome):
        title, x, y = _VIEWS[view]
        _draw_paths(ax, session, arms, title, x, y)
        return
    if view == 0:
        _draw_picture(ax, outcome.aligned, outcome.required)
    else:
        _draw_angle(ax, session, outcome.aligned, outcome.required)


def _draw_speeds(ax: Axes, session: ConsoleSession, arms: list[tuple[str, str]]) -> None:
    """Draw the speed of each tip over time, and the limit below which a tip is at rest."""
    for color, (_, name) in zip(PALETTE, arms, strict=False):
        speed = movement.speed(session.arms[name].tip, session.run.recording.dt) / MM
        t, y = thinned_curve(session.t, speed, _MAX_CURVE_POINTS)
        ax.plot(t, y, color=color, lw=0.8)
    rest_radius = movement.RESTS / MM
    ax.axhline(rest_radius, color=INK, lw=0.6, ls=(0, (5, 2)))
    ax.annotate(
        "at rest",
        (1, rest_radius),
        (0, 2),
        xycoords=("axes fraction", "data"),
        textcoords="offset points",
        ha="right",
        va="bottom",
        fontsize=7,
    )
    ax.set_ylabel("speed [mm/s]")
    ax.set_ylim(0, None)
    ax.tick_params(labelbottom=False, length=2.5)


def _draw_picture(ax: Axes, aligned: AlignMeasures, goal: Alignment) -> None:
    """Draw, as seen in the picture, the target line, and the rectangle's upper side at the start and at the end."""
    half = goal.line
    ax.plot([-half, half], [0, 0], color=INK, lw=3, alpha=0.35)
    start = aligned.course[0]
    end = aligned.course[-1]
    ax.plot(start[:, 0], start[:, 1], "--", color=PALETTE[2], lw=1.4)
    ax.plot(end[:, 0], end[:, 1], "-", color=PALETTE[2], lw=1.4)
    ax.set_aspect("equal")
    ax.set_xlim(-1.3, 1.3)
    ax.set_ylim(-1, 1)
    ax.set_title("picture: thick = target line; thin = upper side at start (dashed), end", loc="left", fontsize=9)


def _draw_angle(ax: Axes, session: ConsoleSession, aligned: AlignMeasures, goal: Alignment) -> None:
    """Draw, over time, the angle in the picture from target line to upper side of the rectangle; mark the tolerance."""
    side = aligned.course[:, 1] - aligned.course[:, 0]
    angle = np.arctan2(side[:, 1], side[:, 0]) / DEG
    t, y = thinned_curve(session.t, angle, _MAX_CURVE_POINTS)
    ax.plot(t, y, color=PALETTE[2], lw=1.0)
    tolerance = goal.tolerance / DEG
    ax.axhspan(-tolerance, tolerance, color=NEAR, alpha=0.4, lw=0)
    ax.set_title("AlignErr [deg] over time [s]; band = tolerance", loc="left", fontsize=9)
    ax.yaxis.tick_right()


def _draw_deviation(ax: Axes, session: ConsoleSession, arms: list[tuple[str, str]]) -> None:
    """Draw the machines' deviation from their models over time, the cue's limit, and times of rehearsal and replay.

    The curve of a machine has the colour of its arm, which the head of the figure names.
    """
    arm_colors = {name: color for color, (_, name) in zip(PALETTE, arms, strict=False)}
    colors = {TrainerPhase.REHEARSE: GRID, TrainerPhase.REPLAY: NEAR}
    for machine in session.training:
        times, shown_deviation = thinned_curve(machine.t, machine.deviation / MM, _MAX_CURVE_POINTS)
        ax.plot(times, shown_deviation, color=arm_colors.get(machine.robot, INK), lw=0.9)
        for step in machine.steps:
            if step.phase in colors:
                ax.axvspan(step.begin, step.end, color=colors[step.phase], alpha=0.4, lw=0)
    ax.axhline(session.training[0].limit / MM, color=INK, lw=0.6, ls=(0, (5, 2)))
    ax.set_ylim(0, None)
    ax.set_xlabel("time [s]")
    ax.set_title("deviation from model [mm]; grey: rehearsal, yellow: replay", loc="left", fontsize=9)
    ax.yaxis.tick_right()


def _draw_paths(ax: Axes, session: ConsoleSession, arms: list[tuple[str, str]], title: str, x: int, y: int) -> None:
    """Draw paths of the tips with targets, or with rings and pegs, or with ring and wire, along the axes x and y."""
    for color, (_, name) in zip(PALETTE, arms, strict=False):
        tip = session.arms[name].tip / MM
        _draw_path(ax, tip[:, [x, y]], color=color, lw=0.8)
        ax.plot(tip[:1, x], tip[:1, y], "o", ms=5, mfc="none", mec=color)
    legend = _draw_task_marks(ax, session, arms, x, y)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_title(f"{title}: circle = start{legend}", loc="left", fontsize=8)
    ax.set_xlabel(f"{'xyz'[x]} [mm]")
    ax.set_ylabel(f"{'xyz'[y]} [mm]")


def _draw_task_marks(ax: Axes, session: ConsoleSession, arms: list[tuple[str, str]], x: int, y: int) -> str:
    """Draw what the task is about, along the axes x and y; return the text of the legend, "" without such a task."""
    outcome = session.outcome
    task = session.task
    if task is None:
        return ""
    if isinstance(outcome, TargetOutcome):
        targets = required_goal(task, Targets).targets
        for target, result in zip(targets, outcome.touched, strict=True):
            marker = "x" if result.t is None else "+"
            for hand, point in target.p_world.items():
                p = point / MM
                ax.plot([p[x]], [p[y]], marker, ms=8, mec=_color(arms, hand), mew=1.4)
        return ", cross = target"
    if isinstance(outcome, BoardOutcome):
        for transfer in required_goal(task, Transfers).transfers:
            ring = _positions(session, transfer.ring) / MM
            _draw_path(ax, ring[:, [x, y]], color=INK, lw=0.7, ls=(0, (4, 2)))
            peg = outcome.pegs[transfer.peg].end / MM
            ax.plot([peg[x]], [peg[y]], "s", ms=5, mfc="none", mec=INK)
        return ", dashed = rings, square = peg"
    if isinstance(outcome, GuideOutcome):
        ring = _positions(session, required_goal(task, GuideTable).ring) / MM
        wire = outcome.wire / MM
        ax.plot(wire[:, x], wire[:, y], color=INK, lw=3, alpha=0.35)
        _draw_path(ax, ring[:, [x, y]], color=INK, lw=0.7, ls=(0, (4, 2)))
        return ", dashed = ring, grey = wire"
    return ""


def _draw_path(ax: Axes, points: Array, **style: Any) -> None:
    """Draw a path (k, 2) by every n-th point, so that there are about `_MAX_CURVE_POINTS` points."""
    step = max(1, len(points) // _MAX_CURVE_POINTS)
    ax.plot(points[::step, 0], points[::step, 1], **style)


def _positions(session: ConsoleSession, ring: str) -> Array:
    """Return the positions (k, 3) of a ring in m, in the World."""
    poses = session.run.recording[OBJECT_POSE.of(ring)].reshape(-1, 4, 4)
    return poses[:, :3, 3]


@dataclass(frozen=True)
class _Band:
    """A pedal or a state: `on` (k,) bool is true at the ticks with a bar."""

    name: str
    on: np.ndarray
    color: str


def _rows(session: ConsoleSession, arms: list[tuple[str, str]]) -> list[_Band]:
    """Return the bands of pedals and states."""
    log = session.run.recording
    rows = [
        _Band("clutch", log[DEVICE_CLUTCH.of(PEDALS)][:, 0] > 0.5, NEAR),
        _Band("camera", log[DEVICE_CAMERA.of(PEDALS)][:, 0] > 0.5, PALETTE[3]),
    ]
    if DEVICE_SILENT.of(PEDALS) in log.sizes:
        rows.append(_Band("silent", log[DEVICE_SILENT.of(PEDALS)][:, 0] > 0.5, INK))
    for hand in console_scene.console_of(session.scene).hands:
        rows.append(_Band(f"{hand} arm follows", _leads(session, hand), _color(arms, hand)))
    guide = goal_of(session.task, GuideTable)
    if guide is not None:
        ring = guide.ring
        touches = log[OBJECT_RUBS.of(ring)][:, 0] > 0.5
        # the number of the holding instrument; negative: none
        is_held = log[OBJECT_HOLDER.of(ring)][:, 0] >= 0
        rows.append(_Band("wire touched", touches & is_held, INK))
    if session.task is not None and session.task.kind.grasps:
        # the session has contacts of instruments with props and objects
        for hand, name in arms:
            rows.append(_Band(f"{name} touches", _hits(session, name), _color(arms, hand)))
    return rows


def _draw_bands(ax: Axes, session: ConsoleSession, arms: list[tuple[str, str]], rows: list[_Band]) -> None:
    """Draw one band over time for each pedal, state and gripper; the gripper's angle is a curve in its band."""
    log = session.run.recording
    t = session.t
    names = []
    for k, row in enumerate(rows):
        spans = []
        for first, last in movement.runs(row.on):
            spans.append((t[first], t[last] - t[first] + log.dt))
        ax.broken_barh(spans, (k - 0.35, 0.7), color=row.color, lw=0)
        names.append(row.name)
    for hand in console_scene.console_of(session.scene).hands:
        grip = log[HAND_GRIP.of(hand)][:, 0]
        span = float(np.ptp(grip))
        opening = (grip - grip.min()) / max(span, 1e-9)
        times, shown_opening = thinned_curve(t, opening, _MAX_CURVE_POINTS)
        # the y axis points down
        ax.plot(times, len(names) + 0.35 - 0.7 * shown_opening, color=_color(arms, hand), lw=1.0)
        names.append(f"{hand} grip, {span / DEG:.0f}°")
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.set_xlim(0, max(float(t[-1]), log.dt))
    ax.set_xlabel("time [s]")
    ax.grid(False)
    ax.tick_params(length=2.5)


def _hits(session: ConsoleSession, robot: str) -> np.ndarray:
    """Return (k,) bool: whether a robot's instrument touches a fixed part or the other instrument at each tick."""
    touches = session.run.recording[ROBOT_TOUCHES.of(robot)][:, 0] > 0.5
    meets = session.run.recording[ROBOT_MEETS.of(robot)][:, 0] > 0.5
    return touches | meets


def _leads(session: ConsoleSession, hand: str) -> np.ndarray:
    """Return (k,) bool: whether an arm of a hand follows the hand at each tick."""
    names = getattr(console_scene.console_of(session.scene), hand)
    follows = []
    for name in names:
        follows.append(session.run.recording[ROBOT_FOLLOWS.of(name)][:, 0] > 0.5)
    return np.any(follows, axis=0)


def _color(arms: list[tuple[str, str]], hand: str) -> str:
    """Return the colour of the first arm of a hand."""
    hands = [owner for owner, _ in arms]
    return PALETTE[hands.index(hand)]
