"""Check the equations of a console against clauses: requirements on the motion of tool and camera, and on the force.

Each clause applies a motion of the hands, and compares the resulting motion with the geometrically required motion.
Rotations are computed by SciPy, and units are this file's own: the judge shares no code with the equations.

Frames: {H} is the frame of the hand, {RB} the frame of the robot base. T is the pose of {H} in {RB}, W is the pose of
the handle in {H}, and P is the pose of the tool in {RB}; R_T is the rotation matrix of T. Messages use the equation
numbers of the paper, and these symbols: p, R (position and rotation of the tool), h, R_H (position and rotation of the
hand), d (a change), s (the motion scale).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from twin.core.progress import Progress, silent
from twin.validation.console_result import Array, Clause, ConsoleResult, shown_number

_MM = 1e-3
"""One millimetre in m."""

_POSITION_ROUNDING = 1e-12
"""Rounding error of a position in m."""

_ANGLE_ROUNDING = 1e-7
"""Rounding error in deg of a product of `_INCREMENTS` rotations."""

_ROLL_ROUNDING = 1e-9
"""Rounding error of a camera roll, in deg or mm^2."""

_FORCE_ROUNDING = 1e-6
"""Rounding error of a force in N."""

_FORCE_PER_DEPTH = 0.6
"""Force in N of a surface at a depth of 1 mm at rest, by the constant of the paper in N/mm."""

_FORCE_PER_RATE = 0.1
"""Force in N of a surface that moves at 10 mm/s, by the constant of the paper, 0.01 N s/mm."""

_ANGLE_LEVER = 1e-4
"""Length in m by which an angle counts as a distance: `_POSITION_ROUNDING` then limits angles to 1e-8 rad."""

_INCREMENTS = 10_000
"""Number of increments of a closed path: even an error of a rounding size in each of them would add up and be seen."""

_MOTION_SCALE = 0.5
"""Motion scale of the clauses in which the scale matters; with 1, a missing scale would not be seen."""

_CameraRolls = Callable[[Array, Array, Array, Array], tuple[float, float]]
"""Function of positions (3,) of right and left hand, before and after a motion: the camera roll by each hand."""

_PEN_FORCE = 3.3
"""Largest force in N of a haptic pen: the manufacturer's value, ASSUMED because the paper gives none."""


class JudgedConsole(Protocol):
    """Interface of a judged console, as implemented by `twin.simulation.controllers.console_equations`.

    Attributes:
        name, title, source: identifier, title and source document.
        variants: variant in use, by name of the equation.
        force_model: name of the force model.
        force_units: units of stiffness and damping; "" if not stated.
        turn_unit: unit of the result of `turns`.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def title(self) -> str: ...  # noqa: D102
    @property
    def source(self) -> str: ...  # noqa: D102
    @property
    def variants(self) -> Mapping[str, str]: ...  # noqa: D102
    @property
    def force_model(self) -> str: ...  # noqa: D102
    @property
    def force_units(self) -> str: ...  # noqa: D102
    @property
    def turn_unit(self) -> str: ...  # noqa: D102

    def tool(self, P_0: Array, W_0: Array, W_1: Array, T: Array, scale: float) -> Array:
        """Return the tool pose (4, 4) in {RB}, the frame of the robot's base, at the end of a motion of the handle.

        The tool starts at P_0 (4, 4) in {RB}; the handle moves from W_0 to W_1 (4, 4) in {H}, the frame of the hand.
        T (4, 4) is the pose of {H} in {RB}; `scale` is the tool displacement divided by the hand displacement.
        """
        ...

    def turns(self, p_R0: Array, p_R1: Array, p_L0: Array, p_L1: Array, n: Array) -> tuple[float, float]:
        """Return two values of the camera roll about the axis n (3,), from the motion of each hand, right hand first.

        The unit is `turn_unit`. p_R0 and p_R1 (3,) in m are the positions of the right hand before and after the
        motion, p_L0 and p_L1 (3,) in m those of the left hand.
        """
        ...

    def force(self, depth: float, rate: float) -> float:
        """Return the force in N of a surface on the tool at `depth` in m; `rate` in m/s is the rate of the depth.

        A positive force pulls the tool into the surface, a negative force pushes the tool out.
        """
        ...

    def error(self, P_0: Array, P_1: Array, W_0: Array, W_1: Array, T: Array, scale: float) -> Array:
        """Return the error (4, 4) of a tool motion from P_0 to P_1, if the handle moves from W_0 to W_1; see `tool`."""
        ...


def judge(console: JudgedConsole, progress: Progress = silent) -> ConsoleResult:
    """Measure every clause (requirement) on a console and return the result."""
    clauses: list[Clause] = []
    steps = len(_CLAUSES_BY_LABEL) + 1
    for i, (label, clauses_of_group) in enumerate(_CLAUSES_BY_LABEL.items()):
        progress(label, i / steps)
        clauses += clauses_of_group(console)
    progress("closed loop", len(_CLAUSES_BY_LABEL) / steps)
    of_loop, path = _closed_loop(console)
    clauses += of_loop
    return ConsoleResult(
        console=console.name,
        title=console.title,
        source=console.source,
        variants=console.variants,
        clauses=clauses,
        path=path,
    )


# -- one hand, one tool ---------------------------------------------------------------------------------------------


def _hand_at_rest(console: JudgedConsole) -> Iterator[Clause]:
    """Yield the clauses on a hand at rest, with a frame {H} that is turned or shifted in {RB}."""
    P = _pose((50 * _MM, 0, 0))
    W = _pose((30 * _MM, -20 * _MM, 10 * _MM), (0.3, 0.2, -0.1))
    for name, place, T in (
        ("still", "{H} turned 90 deg in {RB}", _pose((0, 0, 0), (0, 0, np.pi / 2))),
        ("still.shifted", "{H} offset 100 mm from {RB}", _pose((0.1, 0, 0))),
    ):
        shift, turned = _difference(P, console.tool(P, W, W, T, 1.0))
        yield _position_clause(
            name,
            "eq2",
            text=f"while the hand is at rest, the tool is at rest ({place})",
            distance=shift,
            violation=(
                f"the hand is at rest ({place}), and the tool moves {shift / _MM:.3f} mm and turns {turned:.3f} deg: "
                "with W1 = W0, eq. (2) gives T, not the identity"
            ),
            advice="complete the change of frame, T (W1 W0^-1) T^-1, or transform increments by R_T, the rotation of T",
        )


def _turn_of_hand(console: JudgedConsole) -> Iterator[Clause]:
    """Yield the clauses on a hand that turns in place: position of the tool, then its rotation."""
    P = _pose((50 * _MM, 0, 0))
    W = _pose((0, 0, 0))
    quarter_turn = _pose((0, 0, 0), (0, 0, np.pi / 2))
    shift, _ = _difference(P, console.tool(P, W, quarter_turn, np.eye(4), 1.0))
    yield _position_clause(
        "turn",
        "eq1",
        text="a pure rotation of the hand does not move the tool's wrist",
        distance=shift,
        violation=(
            f"the hand turns 90 deg in place, and the tool moves {shift / _MM:.3f} mm: the tool turns about the hand's "
            "origin, 50 mm away, and not about its own origin"
        ),
        advice="turn the tool about its own origin: R1 = dR R0, p1 = p0 + dp",
    )
    T = _pose((0, 0, 0), (0.4, -0.7, 0.5))
    turn = np.array([0.2, 0.5, -0.3])  # rotation vector of the hand in {H}
    turned = console.tool(P, W, _pose((0, 0, 0), turn), T, 1.0)[:3, :3] @ P[:3, :3].T
    required = Rotation.from_rotvec(T[:3, :3] @ turn).as_matrix()
    deviation = _angle(turned @ required.T)
    yield _limited_clause(
        "turn.angle",
        "eq2",
        text="the tool turns by the angle of the hand, about the hand's axis, converted from {H} to {RB}",
        value=deviation,
        unit="deg",
        limit=_ANGLE_ROUNDING,
        violation=f"the tool orientation differs by {deviation:.3f} deg from the hand rotation expressed in {{RB}}",
        advice="transform the rotation by R_T on both sides: R_T dR R_T^T",
    )


def _scaled_motion(console: JudgedConsole) -> Iterator[Clause]:
    """Yield the clause on direction and length of the tool's motion, with a scale and a turned frame {H}."""
    T = _pose((0, 0, 0), (0, 0, np.pi / 2))
    P = _pose((50 * _MM, 0, 0))
    W_0 = _pose((0, 0, 0))
    W_1 = _pose((10 * _MM, 0, 0))
    shift = console.tool(P, W_0, W_1, T, _MOTION_SCALE)[:3, 3] - P[:3, 3]
    deviation = float(np.linalg.norm(shift - [0, _MOTION_SCALE * 10 * _MM, 0]))
    yield _position_clause(
        "scale",
        "eq2",
        text=(
            f"at scale {_MOTION_SCALE:g}, with {{H}} turned 90 deg about z of {{RB}}, a hand that moves 10 mm "
            "along x of {H} moves the tool 5 mm along y of {RB}"
        ),
        distance=deviation,
        violation=(
            f"at scale {_MOTION_SCALE:g} the hand moves 10 mm along x of {{H}} and the tool moves "
            f"({_position_text(shift)}) mm in {{RB}}: the distance from (0, 5, 0) mm is {deviation / _MM:.3f} mm"
        ),
        advice="use p1 = p0 + s R_T (h1 - h0), which contains the scale s",
    )


def _regrip(console: JudgedConsole) -> Iterator[Clause]:
    """Yield the clauses on the clutch: the tool at the re-grip, and its motion afterwards."""
    T = _pose((20 * _MM, 0, 0), (0.3, 0.1, -0.2))
    P = _pose((0, 40 * _MM, -90 * _MM), (0.1, 0.4, 0.0))
    gripped = _pose((30 * _MM, -10 * _MM, 20 * _MM), (0.35, 0.1, -0.2))  # handle pose after moving while declutched
    engaged = console.tool(P, gripped, gripped, T, _MOTION_SCALE)
    jump, _ = _difference(P, engaged)
    yield _position_clause(
        "regrip",
        "eq2",
        text="the tool stays at rest when the hand releases the clutch, moves and engages it again (re-grip)",
        distance=jump,
        violation=f"after a re-grip 37 mm away the tool jumps {jump / _MM:.3f} mm",
        advice="measure increments from the hand pose at re-grip, and transform them by R_T, the rotation of T",
    )
    step = np.array([0, 0, 10 * _MM])
    deviation = _displacement_error(console, engaged, gripped, step, T)
    yield _position_clause(
        "regrip.way",
        "eq2",
        text="after a re-grip, the hand moves the tool as before",
        distance=deviation,
        violation=(
            f"after a re-grip the hand moves 10 mm, and the tool ends {deviation / _MM:.3f} mm from the correct "
            "position"
        ),
        advice="p1 = p0 + s R_T (h1 - h0), with h0 the hand position at the re-grip",
    )


def _displacement_error(console: JudgedConsole, P: Array, W: Array, step: Array, T: Array) -> float:
    """Return by how far, in m, a tool at P misses the way of a hand that moves from W by `step` (3,) without scale."""
    shift = console.tool(P, W, _translated(W, step), T, 1.0)[:3, 3] - P[:3, 3]
    return float(np.linalg.norm(shift - T[:3, :3] @ step))


def _camera_motion(console: JudgedConsole) -> Iterator[Clause]:
    """Yield the clauses on a camera that moves, which changes T: the tool meanwhile, and its motion afterwards."""
    W = _pose((10 * _MM, 20 * _MM, 0))
    T_before = _pose((0, 0, 0))
    T_after = _pose((30 * _MM, 0, 0), (0, 0, np.pi / 6))
    P_before = console.tool(_pose((0, 0, -100 * _MM)), W, W, T_before, _MOTION_SCALE)
    P_after = console.tool(P_before, W, W, T_after, _MOTION_SCALE)
    jump, _ = _difference(P_before, P_after)
    yield _position_clause(
        "camera.still",
        "eq2",
        text="moving the camera does not move the tool while the hand is still",
        distance=jump,
        violation=f"the camera turns 30 deg with the hand still, and the tool moves {jump / _MM:.3f} mm",
        advice="express increments of the hand in the current frame of the camera: T must cancel when W1 = W0",
    )
    step = np.array([10 * _MM, 0, 0])
    deviation = _displacement_error(console, P_after, W, step, T_after)
    yield _position_clause(
        "camera.way",
        "eq2",
        text="after the camera has turned, the tool moves in the camera image in the direction of the hand",
        distance=deviation,
        violation=(
            f"the camera has turned 30 deg, the hand moves 10 mm, and the tool ends {deviation / _MM:.3f} mm from the "
            "correct position"
        ),
        advice="use T of the current time step, not T of the start",
    )


def _origin_of_hand(console: JudgedConsole) -> Iterator[Clause]:
    """Yield the clause on one motion of the hand, described from two origins of {H}."""
    T = _pose((20 * _MM, 0, 0), (0.3, 0.1, -0.2))
    P = _pose((0, 40 * _MM, -90 * _MM))
    W_0 = _pose((10 * _MM, 0, 0))
    W_1 = _pose((15 * _MM, 5 * _MM, 0), (0.1, 0, 0.2))
    # the same motion of the hand, seen from another origin of {H}
    origin = np.array([200 * _MM, 0, 0])
    shifted = console.tool(
        P, _translated(W_0, -origin), _translated(W_1, -origin), T @ _pose(tuple(origin)), _MOTION_SCALE
    )
    deviation, _ = _difference(console.tool(P, W_0, W_1, T, _MOTION_SCALE), shifted)
    yield _position_clause(
        "origin",
        "eq2",
        text="the position of the origin of {H} has no effect",
        distance=deviation,
        violation=(
            f"with the origin of {{H}} shifted 200 mm, the tool ends {deviation / _MM:.3f} mm from the correct position"
        ),
        advice="use differences of positions and the rotation of T alone",
    )


def _left_handed_scene(console: JudgedConsole) -> Iterator[Clause]:
    """Yield the clause on a motion in a mirrored scene, as in a game engine with left-handed coordinates."""
    S = np.diag([1.0, 1, -1, 1])  # the mirror at the plane z = 0; it is its own inverse
    T = _pose((20 * _MM, 0, 5 * _MM), (0.3, 0.1, -0.2))
    P = _pose((0, 40 * _MM, -90 * _MM), (0.1, 0.2, 0.3))
    W_0 = _pose((10 * _MM, 0, 0), (0, 0.2, 0.1))
    W_1 = _pose((15 * _MM, 5 * _MM, 2 * _MM), (0.1, 0, 0.2))
    mirrored = S @ console.tool(S @ P @ S, S @ W_0 @ S, S @ W_1 @ S, S @ T @ S, _MOTION_SCALE) @ S
    shift, turned = _difference(console.tool(P, W_0, W_1, T, _MOTION_SCALE), mirrored)
    yield _position_clause(
        "left_handed",
        "eq2",
        text="in a left-handed scene (mirror S: p' = S p, R' = S R S) the motion is the mirror image",
        distance=shift + np.radians(turned) * _ANGLE_LEVER,
        violation=(
            f"in a left-handed scene the tool ends {shift / _MM:.3f} mm and {turned:.3f} deg from the mirrored pose"
        ),
        advice="mirror both positions and rotations: p' = S p, R' = S R S",
    )


def _closed_loop(console: JudgedConsole) -> tuple[list[Clause], Array]:
    """Move the hand once around a closed loop while it rotates, in many increments; return clauses and tool path."""
    T = _pose((0, 0, 0), (0, 0, np.pi / 2))
    start = _pose((0, 40 * _MM, -90 * _MM), (0.1, 0.2, 0.3))
    P = start
    path = [P[:3, 3]]
    # increments of a console come one by one, each with its own rounding
    for before, after in pairwise(_closed_path()):
        P = console.tool(P, before, after, T, _MOTION_SCALE)
        path.append(P[:3, 3])
    shift, turned = _difference(start, P)
    advice = "let the increments of a closed loop cancel: sum positions, multiply rotations in one frame"
    where = f"in {_INCREMENTS} increments"
    position = _position_clause(
        "loop",
        "eq2",
        text=f"a closed path of the hand returns the tool to its position, {where}",
        distance=shift,
        violation=(
            f"the hand returns after {_INCREMENTS} increments, and the tool is {shown_number(shift / _MM)} mm from its "
            "start"
        ),
        advice=advice,
    )
    orientation = _limited_clause(
        "loop.angle",
        "eq2",
        text=f"a closed path of the hand returns the tool to its orientation, {where}",
        value=turned,
        unit="deg",
        limit=_ANGLE_ROUNDING,
        violation=f"the hand returns after {_INCREMENTS} increments, and the tool has turned {turned:.3g} deg",
        advice=advice,
    )
    return [position, orientation], np.array(path)


def _closed_path() -> Array:
    """Return poses (k, 4, 4) of the handle along a closed path; the last pose is exactly the first."""
    k = np.arange(_INCREMENTS + 1)
    phase = 2 * np.pi * k / _INCREMENTS
    turns = np.column_stack([0.6 * np.sin(phase), 0.4 * np.sin(2 * phase), 0.8 * (1 - np.cos(phase))])
    W = np.tile(np.eye(4), (len(k), 1, 1))
    W[:, :3, 3] = 50 * _MM * np.column_stack([np.cos(phase), np.sin(phase), 0.5 * np.sin(2 * phase)])
    W[:, :3, :3] = Rotation.from_rotvec(turns).as_matrix()
    W[-1] = W[0]
    return W


# -- two hands, one camera ------------------------------------------------------------------------------------------


def _roll(console: JudgedConsole) -> Iterator[Clause]:
    """Yield the clauses on the roll of the camera by two hands; the printed equation gives an area, not an angle."""
    in_angle = console.turn_unit == "rad"
    if in_angle:
        unit = "deg"
        factor = 180 / np.pi
    else:
        unit = "mm^2"
        factor = 1e6

    def turns(p_R0: Array, p_R1: Array, p_L0: Array, p_L1: Array) -> tuple[float, float]:
        """Return the roll about z by each hand in `unit`; for the arguments see `JudgedConsole.turns`."""
        by_right, by_left = console.turns(p_R0, p_R1, p_L0, p_L1, np.array([0.0, 0, 1]))
        return factor * by_right, factor * by_left

    yield from _roll_of_turn(turns, unit, in_angle)
    yield from _roll_of_lift(turns, unit, in_angle)


def _roll_of_turn(turns: _CameraRolls, unit: str, in_angle: bool) -> Iterator[Clause]:
    """Yield the clauses on hands that turn together about the camera's axis by 3 deg."""
    turn = Rotation.from_rotvec((0, 0, np.radians(3))).as_matrix()
    right = np.array([50, 20, 0]) * _MM
    left = np.array([-50, -20, 0]) * _MM
    by_right, by_left = turns(right, turn @ right, left, turn @ left)
    smallest = float(np.min([by_right, by_left]))  # not a number if one of both is none: it is not positive then
    yield Clause(
        "roll.direction",
        "eq4",
        text="if the hands turn 3 deg counter-clockwise, the camera roll is positive",
        value=smallest,
        unit=unit,
        limit=0.0,
        holds=smallest > 0,
        violation=(
            f"a hand at (50, 20, 0) mm that turns +3 deg (counter-clockwise) gives {by_right:.0f} {unit}. The paper "
            "labels negative values clockwise: p1 x p0 points opposite to the axis of the turn from p0 to p1"
        ),
        advice="swap the factors: c = p0 x p1",
    )
    if in_angle:
        deviation = _largest(by_right - 3, by_left - 3)
        violation = f"hands that turn 3 deg give {by_right:.3f} and {by_left:.3f} deg"
    else:
        # an area cannot be compared with 3 deg: it is shown, and the clause fails by its unit
        deviation = smallest
        violation = (
            "a cross product is an area and a displacement is a length: the paper prints no conversion to an angle"
        )
    yield _limited_clause(
        "roll.angle",
        "eq4",
        text="if the hands turn 3 deg, the camera roll is 3 deg",
        value=deviation,
        unit=unit,
        limit=_ROLL_ROUNDING,
        violation=violation,
        advice="roll = atan2((v0 x v1).n, v0.v1) with v = p_R - p_L",
        further_condition=in_angle,
    )


def _roll_of_lift(turns: _CameraRolls, unit: str, in_angle: bool) -> Iterator[Clause]:
    """Yield the clauses on hands at +-80 mm that move up or down by 5 mm."""
    right = np.array([80, 0, 0]) * _MM
    left = np.array([-80, 0, 0]) * _MM
    up = np.array([0, 5, 0]) * _MM
    by_right, by_left = turns(right, right + up, left, left - up)
    origin = np.array([200, 0, 0]) * _MM
    from_right, from_left = turns(right + origin, right + up + origin, left + origin, left - up + origin)
    deviation = _largest(by_right - from_right, by_left - from_left)
    contradiction = ""
    if from_right * from_left < 0:
        contradiction = ": the signs disagree"
    yield _limited_clause(
        "roll.origin",
        "eq4",
        text="the position of the origin has no effect on the roll",
        value=deviation,
        unit=unit,
        limit=_ROLL_ROUNDING,
        violation=(
            f"right hand +5 mm, left hand -5 mm: (c_zR, c_zL) = ({by_right:+.0f}, {by_left:+.0f}) {unit} with the "
            "hands at "
            f"+-80 mm, ({from_right:+.0f}, {from_left:+.0f}) {unit} with the origin shifted 200 mm{contradiction}"
        ),
        advice="use v = p_R - p_L, which does not depend on the origin",
    )
    lift_right, lift_left = turns(right, right + up, left, left + up)
    yield _limited_clause(
        "roll.lift",
        "eq4",
        text="both hands moving up together do not roll the camera",
        value=_largest(lift_right, lift_left),
        unit=unit,
        limit=_ROLL_ROUNDING,
        violation=f"both hands move up 5 mm: (c_zR, c_zL) = ({lift_right:+.0f}, {lift_left:+.0f}) {unit}, not zero; "
        "the paper states the condition 'parallel and discordant' only in words",
        advice="use v = p_R - p_L, which a common motion does not change",
    )
    required = np.degrees(np.arctan2(5, 80))
    if in_angle:
        deviation = _largest(by_right - required, by_left - required)
    else:
        deviation = _largest(by_right, by_left)
    yield _limited_clause(
        "roll.opposed",
        "eq4",
        text=f"hands at +-80 mm that move +-5 mm roll the camera {required:.3f} deg",
        value=deviation,
        unit=unit,
        limit=_ROLL_ROUNDING,
        violation=(
            f"hands at +-80 mm that move +-5 mm give ({by_right:+.4g}, {by_left:+.4g}) {unit}, not {required:.3f} deg"
        ),
        advice="roll = atan2((v0 x v1).n, v0.v1) with v = p_R - p_L",
        further_condition=in_angle,
    )


# -- forces, and the check of the paper itself ----------------------------------------------------------------------


def _force_of_surface(console: JudgedConsole) -> Iterator[Clause]:
    """Yield the clauses on the force of a surface: units, model, direction and size."""
    resting = abs(console.force(1 * _MM, 0.0))
    moving = abs(console.force(1e-9, 10 * _MM))  # at the surface, where only the damping acts
    yield from _description_of_force(console, resting, moving)
    # near the surface and fast: there, the damping outweighs the spring if nothing prevents it
    pull = console.force(0.1 * _MM, -100 * _MM)
    yield _limited_clause(
        "force.pull",
        "eq5",
        text="a surface never pulls inwards",
        value=max(pull, 0.0),
        unit="N",
        limit=0.0,
        violation=(
            f"at a depth of 0.1 mm, while it moves outwards at 100 mm/s, the tool is pulled inwards by {pull:.2f} N"
        ),
        advice="set a force that points inwards to 0",
    )
    forces = []
    for depth in (1, 5, 10, 20):
        for rate in (-0.1, 0.0, 0.1):
            forces.append(console.force(depth * _MM, rate))
    largest = _largest(*forces)
    yield _limited_clause(
        "force.largest",
        "eq5",
        text="no force exceeds the maximum force of the haptic pen",
        value=largest,
        unit="N",
        limit=_PEN_FORCE,
        violation=f"down to 20 mm depth the force reaches {largest:.1f} N; a pen can apply {_PEN_FORCE:g} N (ASSUMED)",
        advice=f"limit the force to {_PEN_FORCE:g} N, the maximum of the device",
    )
    deviation = _largest(resting - _FORCE_PER_DEPTH, moving - _FORCE_PER_RATE)
    yield _limited_clause(
        "force.size",
        "eq5",
        text="a depth of 1 mm at rest gives 0.6 N; a rate of 10 mm/s at the surface gives 0.1 N",
        value=deviation,
        unit="N",
        limit=_FORCE_ROUNDING,
        violation=(
            f"a depth of 1 mm at rest gives {resting:.3g} N; a rate of 10 mm/s at the surface gives {moving:.3g} N"
        ),
        advice="0.6 N/mm and 0.01 N s/mm",
    )


def _description_of_force(console: JudgedConsole, resting: float, moving: float) -> Iterator[Clause]:
    """Yield the clauses on what the paper says of the force: its units and its name.

    `resting` and `moving` are the forces in N at a depth of 1 mm at rest, and at a rate of 10 mm/s at the surface.
    """
    yield _limited_clause(
        "force.units",
        "eq5",
        text="stiffness and damping have units",
        value=0.0 if console.force_units else 1000.0,  # N/mm or N/m: a factor of 1000 between the two readings
        unit="times",
        limit=1.0,
        violation=(
            f"the constants have no units: in N/mm, 1 mm gives {1e3 * resting:.0f} mN and 10 mm/s {1e3 * moving:.0f} "
            f"mN; in N/m, {resting:.1g} and {moving:.1g} mN, which is imperceptible"
        ),
        advice="state the units; N/mm and N s/mm give perceptible forces",
    )
    yield _limited_clause(
        "force.model",
        "eq5",
        text="the model has the terms that its name implies",
        value=float("mass" in console.force_model),
        unit="terms missing",
        limit=0.0,
        violation=f"the paper calls it a {console.force_model} model, but no term contains a mass or an acceleration",
        advice="call the model a spring-damper, or add the term m d2x/dt2",
    )


def _error_definition(console: JudgedConsole) -> Iterator[Clause]:
    """Yield the clauses on the error that the paper defines: zero for an exact motion, and not zero for a wrong one."""
    P = _pose((50 * _MM, 0, 0))
    W_0 = _pose((30 * _MM, 0, 0))
    W_1 = _pose((40 * _MM, 0, 0), (0, 0, 0.2))
    T = _pose((0.1, 0, 0), (0, 0, np.pi / 2))
    P_required = P.copy()
    P_required[:3, 3] += _MOTION_SCALE * T[:3, :3] @ (W_1 - W_0)[:3, 3]
    P_required[:3, :3] = Rotation.from_rotvec(T[:3, :3] @ [0, 0, 0.2]).as_matrix() @ P[:3, :3]
    error = console.error(P, P_required, W_0, W_1, T, _MOTION_SCALE)
    shift = float(np.linalg.norm(error[:3, 3]))
    turned = _angle(error[:3, :3])
    yield _position_clause(
        "error.right",
        "eq7",
        text="if the tool follows the hand exactly, the error is zero",
        distance=shift,
        violation=f"the tool follows the hand exactly, and eq. (7) gives {shift / _MM:.3f} mm and {turned:.3f} deg",
        advice="e_lin = dp - s R_T dh, e_ang = log(dR (R_T dR_H R_T^T)^T)",
    )
    T = _pose((0, 0, 0), (0, 0, np.pi / 2))
    P_printed = T @ P  # result of the printed eqs (1) and (2) for a hand at rest
    distance = float(np.linalg.norm(P_printed[:3, 3] - P[:3, 3]))
    reported = float(np.linalg.norm(console.error(P, P_printed, W_0, W_0, T, _MOTION_SCALE)[:3, 3]))
    yield _position_clause(
        "error.blind",
        "eq7",
        text="if the tool moves while the hand is still, the error is this motion",
        distance=abs(reported - distance),
        violation=(
            f"the hand is still and the tool moves {distance / _MM:.3f} mm, as in the printed eqs (1), (2): eq. (7) "
            f"gives {reported / _MM:.3f} mm. Eq. (7) is circular: it compares eq. (2) with itself"
        ),
        advice="compare displacements of the tool with displacements of the hand, without eq. (2)",
    )


_CLAUSES_BY_LABEL: dict[str, Callable[[JudgedConsole], Iterator[Clause]]] = {
    "still": _hand_at_rest,
    "turn": _turn_of_hand,
    "way": _scaled_motion,
    "clutch": _regrip,
    "camera": _camera_motion,
    "origin": _origin_of_hand,
    "mirror": _left_handed_scene,
    "roll": _roll,
    "force": _force_of_surface,
    "measure": _error_definition,
}
"""Functions that yield the clauses, by the label of their progress, in the order of the result.

The clauses of the closed loop follow, see `judge`: they also give the path of the tool.
"""


# -- helpers of the clauses ------------------------------------------------------------------------------------------


def _pose(p: Sequence[float], turn: Sequence[float] | Array = (0.0, 0.0, 0.0)) -> Array:
    """Return a pose (4, 4) from a position in m and a rotation vector in rad."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    T[:3, 3] = p
    return T


def _translated(W: Array, by: Array) -> Array:
    """Return a pose (4, 4) moved by a vector (3,) in m."""
    shifted = W.copy()
    shifted[:3, 3] += by
    return shifted


def _difference(P: Array, Q: Array) -> tuple[float, float]:
    """Return (distance in m, angle in deg) between two poses."""
    distance = float(np.linalg.norm(Q[:3, 3] - P[:3, 3]))
    return distance, _angle(Q[:3, :3] @ P[:3, :3].T)


def _angle(R: Array) -> float:
    """Return the angle in deg of a rotation matrix; of another right-handed matrix, that of the nearest rotation.

    A left-handed matrix, or one that is not finite, has no angle: NaN, which no limit allows.
    """
    is_right_handed = np.isfinite(R).all() and np.linalg.det(R) > 0
    if not is_right_handed:
        return float("nan")
    return float(np.degrees(Rotation.from_matrix(R).magnitude()))


def _largest(*deviations: float) -> float:
    """Return the largest absolute value; NaN, which no limit allows, if one of them is NaN."""
    return float(np.abs(deviations).max())


def _position_clause(name: str, equation: str, text: str, distance: float, violation: str, advice: str) -> Clause:
    """Return a clause that holds if the distance in m is at most a rounding error; its values are in mm."""
    return Clause(
        name,
        equation,
        text,
        value=distance / _MM,
        unit="mm",
        limit=_POSITION_ROUNDING / _MM,
        holds=distance <= _POSITION_ROUNDING,
        violation=violation,
        advice=advice,
    )


def _limited_clause(
    name: str,
    equation: str,
    text: str,
    value: float,
    unit: str,
    limit: float,
    violation: str,
    advice: str,
    further_condition: bool = True,
) -> Clause:
    """Return a clause that holds if `value` is at most `limit` and `further_condition` is true."""
    holds = further_condition and value <= limit
    return Clause(
        name,
        equation,
        text,
        value=value,
        unit=unit,
        limit=limit,
        holds=holds,
        violation=violation,
        advice=advice,
    )


def _position_text(v: Array) -> str:
    """Return a vector (3,) in m as text in mm."""
    return ", ".join(f"{x / _MM:.3f}" for x in v)
