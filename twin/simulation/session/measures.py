"""Measures of a session at a console: measures of each arm, and measures of the pedals and the camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.model.console import ConsoleTable
from twin.simulation.console_scene import HANDS, PEDALS
from twin.simulation.controllers.pedals import CAMERA, FREE, TOOLS
from twin.simulation.session import movement
from twin.simulation.world import Recording


@dataclass(frozen=True)
class ArmMeasures:
    """Measures of one arm, from the path of its tip.

    Attributes:
        hand, robot: the hand, and the arm.
        path: length in m of the tip's path.
        movements: number of movements; see `movement.movements`.
        moving: time in s in movements.
        idle: time in s in which the hands control the instruments and the tip is at rest.
        economy: economy of motion, 0 to 1; NaN without a movement.
        smoothness: mean spectral arc length of the movements, negative; 0 is smoothest; NaN without a movement.
        grasps: number of times that the gripper closed beyond the middle of its range of motion in this session.
    """

    hand: str
    robot: str
    path: float
    movements: int
    moving: float
    idle: float
    economy: float
    smoothness: float
    grasps: int


@dataclass(frozen=True)
class ConsoleMeasures:
    """Measures of the whole session; both hands share the pedals.

    Attributes:
        duration: time in s of the session.
        time: time in s from the first moment in which an arm follows its hand to the end; 0 if no arm ever follows a
            hand.
        clutches: number of presses of the clutch.
        clutched: time in s in which the clutch is pressed.
        camera_moves: number of presses of the camera pedal in which the camera moved.
        camera_time: time in s in which the hands control the camera.
        silent: time in s in which the device was silent.
        taps: number of quick taps of the clutch, which select the next arm.
        scale: smallest and largest motion scale.
    """

    duration: float
    time: float
    clutches: int
    clutched: float
    camera_moves: int
    camera_time: float
    silent: float
    taps: int
    scale: tuple[float, float]


def of_arms(kept: Recording, table: ConsoleTable, tips: Mapping[str, Array]) -> list[ArmMeasures]:
    """Return the measures of every arm of both hands.

    Args:
        kept: signals of the session.
        table: the console.
        tips: {arm: positions (k, 3) of its tip in m in the World, at the times of `kept`}.
    """
    return [_arm(kept, hand, name, tips[name]) for hand in HANDS for name in getattr(table, hand)]


def _arm(kept: Recording, hand: str, robot: str, p: Array) -> ArmMeasures:
    dt = kept.dt
    v = movement.speed(p, dt)
    parts = movement.movements(v, dt)
    rests = np.ones(len(v), bool)
    for a, b in parts:
        rests[a : b + 1] = False
    smooth = [movement.spectral_arc_length(v[a : b + 1], dt) for a, b in parts]
    grip = kept[f"{hand}.grip"][:, 0]
    half = (grip.min() + grip.max()) / 2
    closings = np.count_nonzero((grip[:-1] > half) & (grip[1:] <= half)) if np.ptp(grip) > 0 else 0
    return ArmMeasures(
        hand,
        robot,
        movement.path_length(p),
        len(parts),
        float(np.count_nonzero(~rests)) * dt,
        float(np.count_nonzero(rests & (kept["console.mode"][:, 0] == TOOLS))) * dt,
        movement.economy(p, parts),
        float(np.mean(smooth)) if smooth else np.nan,
        int(closings),
    )


def of_console(kept: Recording, table: ConsoleTable, camera: str, duration: float) -> ConsoleMeasures:
    """Return the measures of pedals and camera.

    Args:
        kept: signals of the session.
        table: the console.
        camera: name of the arm of the camera.
        duration: duration of the session in s.
    """
    dt, mode = kept.dt, kept["console.mode"][:, 0]
    silent = kept[f"{PEDALS}.silent"][:, 0] > 0.5 if f"{PEDALS}.silent" in kept.sizes else np.zeros(len(mode), bool)
    clutch = (kept[f"{PEDALS}.clutch"][:, 0] > 0.5) & ~silent
    at, scale = kept[f"{camera}.at"], kept[f"{PEDALS}.scale"]
    begun = np.flatnonzero(np.any([kept[f"{n}.follows"][:, 0] > 0.5 for n in (*table.right, *table.left)], axis=0))
    pressed = movement.runs((kept[f"{PEDALS}.camera"][:, 0] > 0.5) & ~silent)
    moves = [(a, b) for a, b in pressed if np.ptp(at[a : b + 1], axis=0).any()]
    return ConsoleMeasures(
        duration,
        duration - float(kept.t[begun[0]]) if len(begun) else 0.0,
        len(movement.runs(clutch)),
        float(np.count_nonzero(clutch & (mode == FREE))) * dt,
        len(moves),
        float(np.count_nonzero(mode == CAMERA)) * dt,
        float(np.count_nonzero(silent)) * dt,
        int(kept["console.taps"][-1, 0]),
        (float(scale.min()), float(scale.max())),
    )
