"""The ghost: tool pose computed by a chosen variant of the equations, shown beside the mechanism's tool."""

from __future__ import annotations

import time

import numpy as np

from twin.core.errors import KinematicsError, TwinError
from twin.core.spatial import Array
from twin.ui.headset import stream_frames as wire
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.timeline import Playback

_SAMPLES_PER_JOB = 8
"""Number of samples that one job of the worker solves."""

_PAUSE_FACTOR = 10
"""Pause after a pose without a solution, as a multiple of the time spent on this pose; drags can run meanwhile."""


class Ghost:
    """The tool pose computed by the equations for the joint values of the mechanism.

    The event loop calls `pose_at_sample` and `forget`; the worker thread calls all other methods.

    Attributes:
        variant: name of the variant; None: no ghost.
    """

    def __init__(self, movable: MovableRobot) -> None:
        self.variant: str | None = None
        self._movable = movable
        self._kin = None
        self._chosen_variant: str | None = None
        self._playback: Playback | None = None
        self._sample_poses: Array | None = None
        self._processed_samples = 0
        self._failures = 0
        self._next_attempt_time = 0.0

    def forget(self, name: str | None) -> None:
        """Hide the ghost until the next call of `choose`, and store `name` as the name of the variant."""
        self.variant = name
        self._sample_poses = None
        self._kin = None

    def choose(self, name: str | None) -> str:
        """Set the variant of the equations (None: no ghost); return why it cannot be used, or "" if it can."""
        self._kin = None
        self._chosen_variant = name
        self._sample_poses = None
        self._processed_samples = 0
        if name is None:
            return ""
        equation, _, variant = name.partition("=")
        # "eq1=printed" chooses the variant of one equation, "printed" that of every equation that has it
        variants = {equation: variant} if variant else name
        try:
            self._kin = self._movable.robot.kinematics(variants, {})
        except TwinError as error:
            return str(error)
        self._forget_sample_poses()
        return ""

    def follow(self, playback: Playback) -> None:
        """Set the protocol, whose samples `process_samples` processes; the robot must have the protocol's trocars."""
        self._playback = playback
        if self._chosen_variant is not None:
            self.choose(self._chosen_variant)

    def _forget_sample_poses(self) -> None:
        """Forget the poses at the samples of the protocol."""
        self._processed_samples = 0
        self._failures = 0
        self._next_attempt_time = 0.0
        if self._playback is not None:
            self._sample_poses = np.full((len(self._playback.t), 7), np.nan)

    @property
    def has_unprocessed_samples(self) -> bool:
        """Whether `process_samples` has not yet processed all samples of the protocol."""
        return self._sample_poses is not None and self._processed_samples < len(self._sample_poses)

    def process_samples(self) -> bool:
        """Process the next samples of the protocol; return False if all samples were already processed.

        A sample without a solution takes a hundred times as long as a sample with a solution. Therefore, some samples
        are skipped after a sample without a solution, and more samples after each further one in succession.
        """
        track = self._sample_poses
        playback = self._playback
        kin = self._kin
        if track is None or playback is None or kin is None or self._processed_samples >= len(track):
            return False
        # a sample without a solution is slow: with several of them in one job, a drag would wait
        count = 1 if self._failures else _SAMPLES_PER_JOB
        rows = slice(self._processed_samples, self._processed_samples + count)
        try:
            Ts = kin.forward_many(playback.q[rows], playback.Ts_base_tool[rows])
        except KinematicsError:
            Ts = np.full((len(playback.q[rows]), 4, 4), np.nan)
        is_solved = np.asarray(np.isfinite(Ts).all(axis=(1, 2)))
        track[rows][is_solved] = wire.sevens(Ts[is_solved])
        self._processed_samples = rows.stop
        if is_solved[-1]:
            self._failures = 0
        else:
            self._failures += 1
            self._processed_samples += 2 ** min(self._failures, 6)
        return True

    @property
    def is_nowhere_solved(self) -> bool:
        """Whether all samples were processed and no solution was found at any of them."""
        return (
            self._sample_poses is not None
            and not self.has_unprocessed_samples
            and not np.isfinite(self._sample_poses).any()
        )

    def pose_at_sample(self, k: int) -> Array | None:
        """Return the ghost's tool pose (7,) at sample k of the protocol; None without a ghost or a solution."""
        track = self._sample_poses
        if self.variant is None or track is None or not np.isfinite(track[k]).all():
            return None
        return track[k]

    def present_pose(self) -> Array | None:
        """Return the ghost's tool pose (7,) at the joint values of the robot; None without a ghost or a solution."""
        if self.variant is None or self._kin is None:
            return None
        assembly = self._movable.assembly
        start = time.monotonic()
        # the worker would otherwise be busy with poses that have no solution, and drags would wait
        if start < self._next_attempt_time:
            return None
        try:
            return wire.sevens(self._kin.forward(assembly.q, assembly.T_base_tool))
        except KinematicsError:
            end = time.monotonic()
            self._next_attempt_time = end + _PAUSE_FACTOR * (end - start)
            return None
