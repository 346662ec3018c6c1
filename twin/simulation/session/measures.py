"""Measures of a session at a console: measures of each arm, and measures of the pedals and the camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.model.console import ConsoleTable
from twin.simulation.console_scene import PEDALS
from twin.simulation.controllers.pedals import CAMERA, FREE, TOOLS
from twin.simulation.session import movement
from twin.simulation.world import Recording
from twin.simulation.world.signal_kinds import (
    CAMERA_AT,
    CONSOLE_MODE,
    CONSOLE_TAPS,
    DEVICE_CAMERA,
    DEVICE_CLUTCH,
    DEVICE_SCALE,
    DEVICE_SILENT,
    HAND_GRIP,
    ROBOT_FOLLOWS,
)


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
        clutched: time in s in which the clutch is pressed, and the hands are free or, with teleoperation by rates, in
            control.
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


def of_arms(recording: Recording, table: ConsoleTable, tips: Mapping[str, Array]) -> list[ArmMeasures]:
    """Return the measures of every arm of both hands.

    Args:
        recording: signals of the session.
        table: the console.
        tips: {arm: positions (k, 3) of its tip in m in the World, at the times of `recording`}.
    """
    measured = []
    for hand in table.hands:
        for name in getattr(table, hand):
            measured.append(_arm(recording, hand, name, tips[name]))
    return measured


def _arm(recording: Recording, hand: str, robot: str, tip_positions: Array) -> ArmMeasures:
    dt = recording.dt
    speed = movement.speed(tip_positions, dt)
    movements = movement.movements(speed, dt)
    rests = np.ones(len(speed), bool)
    smoothness = []
    for first, last in movements:
        rests[first : last + 1] = False
        smoothness.append(movement.spectral_arc_length(speed[first : last + 1], dt))
    # while the clutch or the camera pedal is pressed, a tip rests on purpose
    idle = rests & (recording[CONSOLE_MODE.name][:, 0] == TOOLS)
    return ArmMeasures(
        hand,
        robot,
        movement.path_length(tip_positions),
        len(movements),
        _duration(~rests, dt),
        _duration(idle, dt),
        movement.economy(tip_positions, movements),
        float(np.mean(smoothness)) if smoothness else np.nan,
        _grasps(recording[HAND_GRIP.of(hand)][:, 0]),
    )


def _grasps(grip: Array) -> int:
    """Return the number of times that a gripper (k,) closed beyond the middle of its range; 0 if it never moved."""
    if np.ptp(grip) == 0:  # a gripper that never moved has no middle to cross
        return 0
    half = (grip.min() + grip.max()) / 2
    closings = (grip[:-1] > half) & (grip[1:] <= half)
    return int(np.count_nonzero(closings))


def _duration(flags: np.ndarray, dt: float) -> float:
    """Return the time in s of the true samples among flags (k,)."""
    return float(np.count_nonzero(flags)) * dt


def of_console(recording: Recording, table: ConsoleTable, camera: str, duration: float) -> ConsoleMeasures:
    """Return the measures of pedals and camera.

    Args:
        recording: signals of the session.
        table: the console.
        camera: name of the arm of the camera.
        duration: duration of the session in s.
    """
    dt = recording.dt
    mode = recording[CONSOLE_MODE.name][:, 0]
    silent = np.zeros(len(mode), bool)
    if DEVICE_SILENT.of(PEDALS) in recording.sizes:  # a simulated surgeon is never silent, and has no such signal
        silent = recording[DEVICE_SILENT.of(PEDALS)][:, 0] > 0.5
    clutch = (recording[DEVICE_CLUTCH.of(PEDALS)][:, 0] > 0.5) & ~silent
    # silence within a press does not make two of it: the pedal is pressed before and after it
    presses = movement.runs(clutch[~silent])
    # At a console with teleoperation by rates, the pedal lets the robot follow; at the others, it lets the hands go.
    clutched_mode = FREE if table.teleoperation is None else TOOLS
    scale = recording[DEVICE_SCALE.of(PEDALS)]
    follows = np.zeros(len(mode), bool)
    for robot in (*table.right, *table.left):
        follows |= recording[ROBOT_FOLLOWS.of(robot)][:, 0] > 0.5
    begun = np.flatnonzero(follows)
    time = duration - float(recording.t[begun[0]]) if len(begun) else 0.0
    camera_pedal = recording[DEVICE_CAMERA.of(PEDALS)][~silent, 0] > 0.5
    positions = recording[CAMERA_AT.of(camera)][~silent]
    camera_moves = 0
    for first, last in movement.runs(camera_pedal):
        if np.ptp(positions[first : last + 1], axis=0).any():
            camera_moves += 1
    return ConsoleMeasures(
        duration,
        time,
        len(presses),
        _duration(clutch & (mode == clutched_mode), dt),
        camera_moves,
        _duration(mode == CAMERA, dt),
        _duration(silent, dt),
        int(recording[CONSOLE_TAPS.name][-1, 0]),
        (float(scale.min()), float(scale.max())),
    )
