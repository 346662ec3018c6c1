"""Simulate computed-torque control along a protocol, and the error caused by model mismatch."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from twin.api.protocol_plan import plan
from twin.api.robot import Robot
from twin.api.robot_loading import loaded
from twin.core.errors import TwinError
from twin.core.progress import Progress, silent

if TYPE_CHECKING:
    from twin.planning.protocol import Protocol
    from twin.simulation.dynamics.computed_torque import Conditions, PlantName
    from twin.simulation.dynamics.tracking_result import Tracking

_SEEDS = (0, 1)
"""Seeds of the runs in which the errors of masses and friction have random signs."""

_INERTIA_ERRORS = tuple(percent / 100 for percent in range(-20, 21, 5))
"""Relative errors of the inertias at which the curve of the tip error is computed."""


def track(
    robot: Robot | str | Path,
    protocol: str | Path | Protocol | None = None,
    *,
    mismatch: float = 0.05,
    plant: PlantName = "mujoco",
    inertia: Literal["cited", "cad"] | None = None,
    curve: bool = False,
    progress: Progress = silent,
) -> Tracking:
    """Simulate computed-torque control along a protocol, with an exact model and with wrong models.

    Args:
        robot: a robot with masses in its description, inertia.toml or stage; or its name or folder.
        protocol: a protocol, its name or its path; default: the robot's default protocol.
        mismatch: relative error (at least 0, below 1) of the masses and inertia tensors in the wrong models.
        plant: simulator of the robot, "mujoco" or "pinocchio"; the controller's model always uses Pinocchio.
        inertia: source of the masses, "cited" (inertia.toml) or "cad" (computed from the CAD); default: "cited" if
            inertia.toml exists, else "cad".
        curve: whether to also compute the tip error for relative inertia errors from -20 % to 20 %.
        progress: see `Progress`.

    Raises:
        TwinError: a mass is unknown, the protocol cannot be planned, or the simulated robot leaves the planned motion.

    Examples:
        >>> import twin
        >>> tracked = twin.track("pa10", "circle")
        >>> tracked.verdict
        'agree'
    """
    from twin.planning.protocol import Protocol
    from twin.reference import inertia as masses
    from twin.simulation.dynamics.arm import arm as arm_of
    from twin.simulation.dynamics.computed_torque import Conditions, DesiredMotion, side_by_side
    from twin.simulation.dynamics.computed_torque import curve as error_curve
    from twin.simulation.dynamics.tracking_result import Tracking

    if not 0 <= mismatch < 1:
        raise TwinError(f"mismatch {100 * mismatch:g} %: give at least 0 % and less than 100 %")
    robot = loaded(robot)
    if not isinstance(protocol, Protocol):
        protocol = robot.protocol(protocol)
    robot = robot.bound(protocol)
    has_table = robot.files is not None and (robot.files.cad / masses.NAME).is_file()
    if inertia is not None:
        source = inertia
    elif has_table:
        source = "cited"
    else:
        source = "cad"
    if source == "cited" and robot.files is None:
        raise TwinError(f"{robot.name} was loaded from {robot.source.kind}: it has no {masses.NAME}")
    table = None
    # also with masses of the CAD: friction and rotors stand in the table; with "cited", a missing table is an error
    if robot.files is not None and (has_table or source == "cited"):
        table = masses.of_robot(robot.files.cad)
    progress("read CAD", 0.0)
    planned = plan(robot, protocol, progress)
    if source == "cad" and robot.files is not None:
        progress("compute masses", 0.0)
        robot = robot.weighed()
    arm = arm_of(robot.mechanism, table, cited=source == "cited")
    if plant == "mujoco":
        from twin.exchange.formats.mjcf.write import mjcf_text

        arm = replace(arm, mjcf=mjcf_text(arm.mechanism))
    T_tool_frame = robot.mechanism.frame_in_tool(planned.frame)
    motion = DesiredMotion(planned.t, planned.q, planned.qd, planned.qdd, T_tool_frame, planned.shaft_axis, planned.rcm)
    exact = Conditions(plant=plant)
    cases = _cases(exact, mismatch)
    control_progress = partial(progress, f"control of {len(cases)} models")
    runs_of_cases = side_by_side(arm, motion, list(cases.values()), control_progress)
    runs = dict(zip(cases, runs_of_cases, strict=True))
    curves = {}
    if curve:
        series = {"links alone": exact, "links, friction, encoders": exact.realistic(0.0)}
        for name, conditions in series.items():
            report = partial(progress, "error curve")
            curves[name] = error_curve(arm, motion, _INERTIA_ERRORS, conditions, report)
    phases = []
    for phase in planned.phases:
        phases.append((phase.name, phase.type, phase.t0, phase.t1))
    return Tracking(
        robot.name, protocol.name, protocol.title, source, arm, motion, tuple(phases), mismatch, runs, curves
    )


def _cases(exact: Conditions, mismatch: float) -> dict[str, Conditions]:
    """Return {name in reports: conditions}: the exact model, and models with wrong masses."""
    from twin.simulation.dynamics.tracking_result import EXACT

    percent = 100 * mismatch
    cases = {EXACT: exact, f"links {percent:+g} %": exact.realistic(mismatch)}
    if mismatch:  # without one, all further cases would be equal to the one above
        cases[f"links {-percent:+g} %"] = exact.realistic(-mismatch)
        for seed in _SEEDS:
            cases[f"links ±{percent:g} %, seed {seed}"] = exact.realistic(mismatch, seed)
    return cases
