"""Draw a session at a console: paths and speeds of the tips, and states of hands and pedals over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.api.console_session import ConsoleSession
from twin.core.units import DEG, MM
from twin.model.alignment import Alignment
from twin.simulation import console_scene
from twin.simulation.console_scene import HANDS, PEDALS
from twin.simulation.controllers.trainer import Phase
from twin.simulation.session import movement
from twin.simulation.session.camera_task import AlignMeasures
from twin.ui.report.curves import thin
from twin.ui.report.style import GRID, INK, NEAR, PALETTE, WIDTH, sheet, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_VIEWS = (("from above", 0, 1), ("from the feet", 0, 2))
"""(Title, horizontal axis, vertical axis) of each view of the paths; an axis is the index of an axis of the World."""

_POINTS = 2000
"""Maximum number of points of a path and of a curve, because the page contains all points."""


@styled()
def figure(found: ConsoleSession) -> Figure:
    """Return a figure of tip paths and targets in two views, speeds of the tips, and states of pedals and grippers.

    In a camera task, the picture and the angle in the picture replace the two views. With machines, the deviation of
    the machines from their models replaces the second view.
    """
    table = console_scene.console_of(found.scene)
    arms = [(hand, name) for hand in HANDS for name in getattr(table, hand)]

    rows = 3 + 2 * len(HANDS) + (len(arms) if _contacts(found) else 0) + (found.guided is not None)
    height = 5.9 + 0.24 * rows
    who = "a person" if found.seed is None else f"simulated surgeon, seed {found.seed}"
    out = sheet(f"{found.scene.name}: session of {found.ran.duration:.1f} s, {who}", height)
    beside = 1.2 if max(len(name) for _, name in arms) < 8 else 1.5  # inches for the names of the bands
    left, wide = beside / WIDTH, (WIDTH - beside - 0.25) / WIDTH
    foot, bands, speeds = 0.5, 0.24 * rows, 1.6
    low = out.add_axes((left, foot / height, wide, bands / height))
    middle = out.add_axes((left, (foot + bands + 0.2) / height, wide, speeds / height), sharex=low)
    base = foot + bands + speeds + 0.75
    tall = height - base - 0.8
    for i, (title, x, y) in enumerate(_VIEWS):
        place = (left + i * (wide / 2 + 0.02), base / height, wide / 2 - 0.06, tall / height)
        ax = out.add_axes(place)
        if found.training and i == 1:
            _deviation(ax, found)
        elif found.aligned is None or found.task is None or found.task.alignment is None:
            _paths(ax, found, arms, title, x, y)
        else:
            (_picture if i == 0 else _angle)(ax, found, found.aligned, found.task.alignment)
        ax.grid(True, color=GRID)
        ax.tick_params(length=2.5)
    for i, (hand, name) in enumerate(arms):
        out.text(0.012 + 0.14 * i, 1 - 0.5 / height, f"{hand}: {name}", color=PALETTE[i], fontsize=9, va="center")
    for color, (_, name) in zip(PALETTE, arms, strict=False):
        v = movement.speed(found.arms[name].tip, found.ran.kept.dt) / MM
        middle.plot(*thin(found.t, v, _POINTS), color=color, lw=0.8)
    middle.axhline(movement.RESTS / MM, color=INK, lw=0.6, ls=(0, (5, 2)))
    middle.annotate(
        "at rest", (1, movement.RESTS / MM), (0, 2), xycoords=("axes fraction", "data"),
        textcoords="offset points", ha="right", va="bottom", fontsize=7,
    )  # fmt: skip
    middle.set_ylabel("speed [mm/s]")
    middle.set_ylim(0, None)
    middle.tick_params(labelbottom=False, length=2.5)
    _bands(low, found, arms)
    return out


def _picture(ax: Axes, found: ConsoleSession, aligned: AlignMeasures, goal: Alignment) -> None:
    """Draw, as seen in the picture, the target line, and the rectangle's upper side at the start and at the end."""
    line = goal.line
    ax.plot([-line, line], [0, 0], color=INK, lw=3, alpha=0.35)
    for ends, style in ((aligned.course[0], "--"), (aligned.course[-1], "-")):
        ax.plot(ends[:, 0], ends[:, 1], style, color=PALETTE[2], lw=1.4)
    ax.set_aspect("equal")
    ax.set_xlim(-1.3, 1.3)
    ax.set_ylim(-1, 1)
    ax.set_title("picture: thick = target line; thin = upper side at start (dashed), end", loc="left", fontsize=9)


def _angle(ax: Axes, found: ConsoleSession, aligned: AlignMeasures, goal: Alignment) -> None:
    """Draw, over time, the angle in the picture from target line to upper side of the rectangle; mark the tolerance."""
    way = aligned.course[:, 1] - aligned.course[:, 0]
    ax.plot(*thin(found.t, np.arctan2(way[:, 1], way[:, 0]) / DEG, _POINTS), color=PALETTE[2], lw=1.0)
    ax.axhspan(-goal.tolerance / DEG, goal.tolerance / DEG, color=NEAR, alpha=0.4, lw=0)
    ax.set_title("AlignErr [deg] over time [s]; band = tolerance", loc="left", fontsize=9)
    ax.yaxis.tick_right()


def _deviation(ax: Axes, found: ConsoleSession) -> None:
    """Draw the machines' deviation from their models over time, the cue's limit, and times of rehearsal and replay."""
    for k, machine in enumerate(found.training):
        times, shown = thin(machine.t, machine.deviation / MM, _POINTS)
        ax.plot(times, shown, color=PALETTE[(2 + k) % len(PALETTE)], lw=0.9)
        for step in machine.steps:
            if step.phase in (Phase.REHEARSE, Phase.REPLAY):
                ax.axvspan(step.begin, step.end, color=GRID if step.phase == Phase.REHEARSE else NEAR, alpha=0.4, lw=0)
    ax.axhline(found.training[0].limit / MM, color=INK, lw=0.6, ls=(0, (5, 2)))
    ax.set_ylim(0, None)
    ax.set_xlabel("time [s]")
    ax.set_title("deviation from model [mm]; grey: rehearsal, yellow: replay", loc="left", fontsize=9)
    ax.yaxis.tick_right()


def _paths(ax: Axes, found: ConsoleSession, arms: list[tuple[str, str]], title: str, x: int, y: int) -> None:
    for i, (_, name) in enumerate(arms):
        p = found.arms[name].tip / MM
        step = max(1, len(p) // _POINTS)
        ax.plot(p[::step, x], p[::step, y], color=PALETTE[i], lw=0.8)
        ax.plot(p[:1, x], p[:1, y], "o", ms=5, mfc="none", mec=PALETTE[i])
    for target, result in zip(found.task.targets if found.task else (), found.touched, strict=True):
        for hand, point in target.p_world.items():
            color = PALETTE[next(i for i, (h, _) in enumerate(arms) if h == hand)]
            ax.plot([point[x] / MM], [point[y] / MM], "+" if result.t is not None else "x", ms=8, mec=color, mew=1.4)
    legend = ", cross = target" if found.task and found.task.targets else ""
    if found.task is not None and found.task.transfers:
        legend = ", dashed = rings, square = peg"
        for transfer in found.task.transfers:
            p = found.ran.kept[f"{transfer.ring}.pose"].reshape(-1, 4, 4)[:, :3, 3] / MM
            step = max(1, len(p) // _POINTS)
            ax.plot(p[::step, x], p[::step, y], color=INK, lw=0.7, ls=(0, (4, 2)))
            peg = found.pegs[transfer.peg].end / MM
            ax.plot([peg[x]], [peg[y]], "s", ms=5, mfc="none", mec=INK)
    if found.guided is not None and found.task is not None and found.task.guide is not None:
        legend = ", dashed = ring, grey = wire"
        p = found.ran.kept[f"{found.task.guide.ring}.pose"].reshape(-1, 4, 4)[:, :3, 3] / MM
        step = max(1, len(p) // _POINTS)
        ax.plot(found.wire[:, x] / MM, found.wire[:, y] / MM, color=INK, lw=3, alpha=0.35)
        ax.plot(p[::step, x], p[::step, y], color=INK, lw=0.7, ls=(0, (4, 2)))
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_title(f"{title}: circle = start{legend}", loc="left", fontsize=8)
    ax.set_xlabel(f"{'xyz'[x]} [mm]")
    ax.set_ylabel(f"{'xyz'[y]} [mm]")


def _bands(ax: Axes, found: ConsoleSession, arms: list[tuple[str, str]]) -> None:
    """Draw one band over time for each pedal, state and gripper; the gripper's angle is a curve in its band."""
    kept, t = found.ran.kept, found.t
    rows: list[tuple[str, np.ndarray, str]] = [
        ("clutch", kept[f"{PEDALS}.clutch"][:, 0] > 0.5, NEAR),
        ("camera", kept[f"{PEDALS}.camera"][:, 0] > 0.5, PALETTE[3]),
    ]
    if f"{PEDALS}.silent" in kept.sizes:
        rows.append(("silent", kept[f"{PEDALS}.silent"][:, 0] > 0.5, INK))
    rows += [(f"{hand} arm follows", _leads(found, hand), _color(arms, hand)) for hand in HANDS]
    if found.guided is not None and found.task is not None and found.task.guide is not None:
        rubs, holder = (kept[f"{found.task.guide.ring}.{what}"][:, 0] for what in ("rubs", "holder"))
        rows.append(("wire touched", (rubs > 0.5) & (holder >= 0), INK))
    if _contacts(found):
        rows += [(f"{n} touches", _hits(found, n), _color(arms, hand)) for hand, n in arms]
    names = []
    for k, (name, on, color) in enumerate(rows):
        spans = [(t[a], t[b] - t[a] + kept.dt) for a, b in movement.runs(on)]
        ax.broken_barh(spans, (k - 0.35, 0.7), color=color, lw=0)
        names.append(name)
    for hand in HANDS:
        grip = kept[f"{hand}.grip"][:, 0]
        size = max(float(np.ptp(grip)), 1e-9)
        times, shown = thin(t, (grip - grip.min()) / size, _POINTS)
        ax.plot(times, len(names) + 0.35 - 0.7 * shown, color=_color(arms, hand), lw=1.0)
        names.append(f"{hand} grip, {np.ptp(grip) / DEG:.0f}°")
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.set_xlim(0, max(float(t[-1]), kept.dt))
    ax.set_xlabel("time [s]")
    ax.grid(False)
    ax.tick_params(length=2.5)


def _contacts(found: ConsoleSession) -> bool:
    """Return whether the session has contacts of instruments with props and objects."""
    return found.board is not None or found.guided is not None


def _hits(found: ConsoleSession, robot: str) -> np.ndarray:
    """Return (k,) bool: whether a robot's instrument touches a fixed part or the other instrument at each tick."""
    return np.any([found.ran.kept[f"{robot}.{what}"][:, 0] > 0.5 for what in ("touches", "meets")], axis=0)


def _leads(found: ConsoleSession, hand: str) -> np.ndarray:
    names = getattr(console_scene.console_of(found.scene), hand)
    return np.any([found.ran.kept[f"{n}.follows"][:, 0] > 0.5 for n in names], axis=0)


def _color(arms: list[tuple[str, str]], hand: str) -> str:
    return PALETTE[next(i for i, (h, _) in enumerate(arms) if h == hand)]
