"""Modes and phases of a trainer, its limits, and the reasons for which it refuses or stops a motion, as sentences."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from twin.core.units import DEG, MM
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_link import PATIENCE
from twin.simulation.world.signal_kinds import DEVICE_TRAINING, PEDALS

MODE = DEVICE_TRAINING.of(PEDALS)
"""Name of the device's setting that requests a mode, see `mode_setting`."""

LONGEST_RECORD = 120.0
"""Largest duration of a record in s."""

LONGEST_SILENCE = 1.0
"""Maximum time in s for which the hands may be silent in a replay (ASSUMED).

The hands do not move the machine in a replay, but the clutch stops it; while the hands are silent, the clutch cannot be
read.
"""


class TrainerMode(IntEnum):
    """Requested mode of the trainer."""

    TELEOPERATE = 0
    REHEARSE = 1
    JUDGE = 2
    REPLAY = 3


def mode_setting(mode: TrainerMode, count: int) -> float:
    """Return the setting that requests a mode; a different `count` requests the same mode again."""
    return float(mode + len(TrainerMode) * count)


def mode_of(setting: float) -> TrainerMode:
    """Return the mode that a setting requests."""
    return TrainerMode(int(setting) % len(TrainerMode))


class TrainerPhase(IntEnum):
    """Current phase of the trainer."""

    TELEOPERATE = 0
    REHEARSE = 1
    JUDGED = 2
    REPLAY = 3
    DONE = 4
    STOPPED = 5


class TrainerReason(IntEnum):
    """Reason why a record was refused or ended, or why a replay stopped."""

    NOTHING = 0
    NO_RECORD = 1
    NOT_READY = 2
    TOO_FAST = 3
    OUT_OF_REACH = 4
    MODEL_STOPPED = 5
    START = 6
    START_ANGLE = 7
    MACHINE_FAST = 8
    DEVIATES = 9
    MACHINE_STOPPED = 10
    OPERATOR = 11
    NOT_JUDGED = 12
    FULL = 13
    MACHINE_SILENT = 14


@dataclass(frozen=True)
class TrainerLimits:
    """Limits of a trainer; see `twin.model.trainer.TrainerTable`.

    Attributes:
        speed, turn: largest speeds of the goal that the increments follow, in m/s and rad/s.
        rehearsed, replayed: largest speeds of the tip in m/s, of the model in a rehearsal and of the machine in a
            replay.
        start, start_angle: largest distance in m of the tip, and largest difference in rad of a joint, from the start
            of the record.
        deviation: largest distance in m between the tips of machine and model in a replay.
    """

    speed: float
    turn: float
    rehearsed: float
    replayed: float
    start: float
    start_angle: float
    deviation: float


def reason_text(reason: TrainerReason, value: float, limits: TrainerLimits, robot: str) -> str:
    """Return a sentence that states a reason with its value, the limit and what to do; "" for NOTHING.

    `value` is in SI: a speed, a distance, an angle, a duration, a number of packets or a run level.
    """
    texts = {
        TrainerReason.NOTHING: "",
        TrainerReason.NO_RECORD: f"there is no record of {robot}: rehearse first",
        TrainerReason.NOT_JUDGED: f"the record of {robot} has not passed its check: rehearse again",
        TrainerReason.FULL: f"the rehearsal was stopped: the record of {robot} is {value:g} s long "
        f"(limit {LONGEST_RECORD:g}). Press Judge to use it, or rehearse again a shorter motion",
        TrainerReason.NOT_READY: f"{robot} is not ready (run level {_level_text(value)}): "
        "press its start button, and wait for PEDAL_UP",
        TrainerReason.TOO_FAST: f"the rehearsed tip moved at {value / MM:.4g} mm/s (limit {limits.rehearsed / MM:g}): "
        "rehearse again more slowly",
        TrainerReason.OUT_OF_REACH: f"{value:.0f} packets had a target out of reach (limit 0): rehearse again within "
        "the ranges of the joints",
        TrainerReason.MODEL_STOPPED: "the model stopped in the rehearsal: rehearse again more slowly",
        TrainerReason.START: f"{robot} is {value / MM:.1f} mm from where the record begins "
        f"(limit {limits.start / MM:g}): move it to the start by teleoperation, or rehearse again from here",
        TrainerReason.START_ANGLE: f"a joint of {robot} is {value / DEG:.1f} deg from where the record begins "
        f"(limit {limits.start_angle / DEG:g}): move it to the start by teleoperation, or rehearse again from here",
        TrainerReason.MACHINE_FAST: f"the replay was stopped: the tip of {robot} moved at {value / MM:.4g} mm/s "
        f"(limit {limits.replayed / MM:g})",
        TrainerReason.DEVIATES: f"the replay was stopped: the tip of {robot} was {value / MM:.1f} mm from its model "
        f"(limit {limits.deviation / MM:g}); find the cause before the next replay",
        TrainerReason.MACHINE_STOPPED: f"the replay was stopped: {robot} left PEDAL_DN "
        f"(run level {_level_text(value)})",
        TrainerReason.MACHINE_SILENT: f"the replay was stopped: no state of {robot} was received for {PATIENCE:g} s; "
        "wait until it answers, then rehearse again",
        TrainerReason.OPERATOR: "the replay was stopped by the clutch, or because the hands were silent for "
        f"{LONGEST_SILENCE:g} s",
    }
    return texts[reason]


def _level_text(value: float) -> str:
    """Return the name of a run level; a number that is none as it is."""
    if min(Level) <= value <= max(Level):
        return Level(int(value)).name
    return str(value)
