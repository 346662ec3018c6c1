"""Check the equations of a console against clauses: requirements on the motion of tool and camera, and on the force.

Each clause applies a motion of the hands, and compares the resulting motion with the geometrically required motion.
Rotations are computed by SciPy, independently of the equations. Frames: {H} is the frame of the hand, {RB} the frame of
the robot base. T is the pose of {H} in {RB}, W is the pose of the handle in {H}, and P is the pose of the tool in {RB};
R_T is the rotation matrix of T. Messages use the equation numbers of the paper, and these symbols: p, R (position and
rotation of the tool), h, R_H (position and rotation of the hand), d (a change), s (the motion scale).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from twin.validation.clauses import Clause, Contract, number

Array = NDArray[np.float64]

_MM = 1e-3
_POINT, _ANGLE = 1e-12, 1e-7
"""Tolerances for rounding errors: of a position in m, and of a rotation in deg (a product of 10 000 rotations)."""

_INCREMENTS = 10_000
_SCALE = 0.5
_PEN = 3.3
"""Largest force in N of a haptic pen: the manufacturer's value, ASSUMED because the paper gives none."""


class Laws(Protocol):
    """Interface of a judged console, as implemented by `twin.simulation.controllers.console`.

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


def judge(console: Laws, progress: Callable[[str, float], None] = lambda label, part: None) -> Contract:
    """Measure every clause (requirement) on a console and return the result."""
    clauses: list[Clause] = []
    path = np.zeros((0, 3))
    for i, part in enumerate((_still, _turn, _way, _clutch, _camera, _origin, _mirror, _roll, _force, _measure)):
        progress(part.__name__.strip("_"), i / 11)
        clauses += part(console)
    progress("closed loop", 10 / 11)
    found, path = _loop(console)
    return Contract(console.name, console.title, console.source, console.variants, [*clauses, *found], path)


# -- one hand, one tool ---------------------------------------------------------------------------------------------


def _still(c: Laws) -> Iterator[Clause]:
    P = _pose((50 * _MM, 0, 0))
    W = _pose((30 * _MM, -20 * _MM, 10 * _MM), (0.3, 0.2, -0.1))
    for name, place, T in (
        ("still", "{H} turned 90 deg in {RB}", _pose((0, 0, 0), (0, 0, np.pi / 2))),
        ("still.shifted", "{H} offset 100 mm from {RB}", _pose((0.1, 0, 0))),
    ):
        moved, turned = _between(P, c.tool(P, W, W, T, 1.0))
        yield _point(
            name,
            "eq2",
            f"while the hand is at rest, the tool is at rest ({place})",
            moved,
            f"the hand is at rest ({place}), and the tool moves {moved / _MM:.3f} mm and turns {turned:.3f} deg: with "
            "W1 = W0, eq. (2) gives T, not the identity",
            "complete the change of frame, T (W1 W0^-1) T^-1, or transform increments by R_T, the rotation of T",
        )


def _turn(c: Laws) -> Iterator[Clause]:
    P, W, turn = _pose((50 * _MM, 0, 0)), _pose((0, 0, 0)), Rotation.from_rotvec((0, 0, np.pi / 2))
    after = c.tool(P, W, _pose((0, 0, 0), turn.as_rotvec()), np.eye(4), 1.0)
    moved, _ = _between(P, after)
    yield _point(
        "turn",
        "eq1",
        "a pure rotation of the hand does not move the tool's wrist",
        moved,
        f"the hand turns 90 deg in place, and the tool moves {moved / _MM:.3f} mm: the tool turns about the hand's "
        "origin, 50 mm away, and not about its own origin",
        "turn the tool about its own origin: R1 = dR R0, p1 = p0 + dp",
    )
    T = _pose((0, 0, 0), (0.4, -0.7, 0.5))
    axis = np.array([0.2, 0.5, -0.3])
    got = c.tool(P, W, _pose((0, 0, 0), axis), T, 1.0)[:3, :3] @ P[:3, :3].T
    wanted = Rotation.from_rotvec(T[:3, :3] @ axis).as_matrix()
    off = _angle(got @ wanted.T)
    yield _within(
        "turn.angle",
        "eq2",
        "the tool turns by the angle of the hand, about the hand's axis, converted from {H} to {RB}",
        off,
        "deg",
        _ANGLE,
        f"the tool orientation differs by {off:.3f} deg from the hand rotation expressed in {{RB}}",
        "transform the rotation by R_T on both sides: R_T dR R_T^T",
    )


def _way(c: Laws) -> Iterator[Clause]:
    T, P = _pose((0, 0, 0), (0, 0, np.pi / 2)), _pose((50 * _MM, 0, 0))
    W_0, W_1 = _pose((0, 0, 0)), _pose((10 * _MM, 0, 0))
    got = c.tool(P, W_0, W_1, T, _SCALE)[:3, 3] - P[:3, 3]
    off = float(np.linalg.norm(got - [0, _SCALE * 10 * _MM, 0]))
    yield _point(
        "scale",
        "eq2",
        f"at scale {_SCALE:g}, with {{H}} turned 90 deg about z of {{RB}}, a hand that moves 10 mm along x of {{H}} "
        "moves the tool 5 mm along y of {RB}",
        off,
        f"at scale {_SCALE:g} the hand moves 10 mm along x of {{H}} and the tool moves ({_triple(got)}) mm in {{RB}}: "
        f"the distance from (0, 5, 0) mm is {off / _MM:.3f} mm",
        "use p1 = p0 + s R_T (h1 - h0), which contains the scale s",
    )


def _clutch(c: Laws) -> Iterator[Clause]:
    T, P = _pose((20 * _MM, 0, 0), (0.3, 0.1, -0.2)), _pose((0, 40 * _MM, -90 * _MM), (0.1, 0.4, 0.0))
    gripped = _pose((30 * _MM, -10 * _MM, 20 * _MM), (0.35, 0.1, -0.2))  # handle pose after moving while declutched
    at_once, _ = _between(P, after := c.tool(P, gripped, gripped, T, _SCALE))
    yield _point(
        "regrip",
        "eq2",
        "the tool stays at rest when the hand releases the clutch, moves and engages it again (re-grip)",
        at_once,
        f"after a re-grip 37 mm away the tool jumps {at_once / _MM:.3f} mm",
        "measure increments from the hand pose at re-grip, and transform them by R_T, the rotation of T",
    )
    step = np.array([0, 0, 10 * _MM])
    went = c.tool(after, gripped, _shifted(gripped, step), T, 1.0)[:3, 3] - after[:3, 3]
    off = float(np.linalg.norm(went - T[:3, :3] @ step))
    yield _point(
        "regrip.way",
        "eq2",
        "after a re-grip, the hand moves the tool as before",
        off,
        f"after a re-grip the hand moves 10 mm, and the tool ends {off / _MM:.3f} mm from the correct position",
        "p1 = p0 + s R_T (h1 - h0), with h0 the hand position at the re-grip",
    )


def _camera(c: Laws) -> Iterator[Clause]:
    P, W = _pose((0, 0, -100 * _MM)), _pose((10 * _MM, 20 * _MM, 0))
    step = np.array([10 * _MM, 0, 0])
    before, after = _pose((0, 0, 0)), _pose((30 * _MM, 0, 0), (0, 0, np.pi / 6))
    P = c.tool(P, W, W, before, _SCALE)
    stood, _ = _between(P, Q := c.tool(P, W, W, after, _SCALE))
    yield _point(
        "camera.still",
        "eq2",
        "moving the camera does not move the tool while the hand is still",
        stood,
        f"the camera turns 30 deg with the hand still, and the tool moves {stood / _MM:.3f} mm",
        "express increments of the hand in the current frame of the camera: T must cancel when W1 = W0",
    )
    went = c.tool(Q, W, _shifted(W, step), after, 1.0)[:3, 3] - Q[:3, 3]
    off = float(np.linalg.norm(went - after[:3, :3] @ step))
    yield _point(
        "camera.way",
        "eq2",
        "after the camera has turned, the tool moves in the camera image in the direction of the hand",
        off,
        f"the camera has turned 30 deg, the hand moves 10 mm, and the tool ends {off / _MM:.3f} mm from the "
        "correct position",
        "use T of the current time step, not T of the start",
    )


def _origin(c: Laws) -> Iterator[Clause]:
    T, P = _pose((20 * _MM, 0, 0), (0.3, 0.1, -0.2)), _pose((0, 40 * _MM, -90 * _MM))
    W_0, W_1 = _pose((10 * _MM, 0, 0)), _pose((15 * _MM, 5 * _MM, 0), (0.1, 0, 0.2))
    o = np.array([200 * _MM, 0, 0])
    there = c.tool(P, _shifted(W_0, -o), _shifted(W_1, -o), T @ _pose(tuple(o)), _SCALE)
    off, _ = _between(c.tool(P, W_0, W_1, T, _SCALE), there)
    yield _point(
        "origin",
        "eq2",
        "the position of the origin of {H} has no effect",
        off,
        f"with the origin of {{H}} shifted 200 mm, the tool ends {off / _MM:.3f} mm from the correct position",
        "use differences of positions and the rotation of T alone",
    )


def _mirror(c: Laws) -> Iterator[Clause]:
    S = np.diag([1.0, 1, -1, 1])
    T, P = _pose((20 * _MM, 0, 5 * _MM), (0.3, 0.1, -0.2)), _pose((0, 40 * _MM, -90 * _MM), (0.1, 0.2, 0.3))
    W_0, W_1 = _pose((10 * _MM, 0, 0), (0, 0.2, 0.1)), _pose((15 * _MM, 5 * _MM, 2 * _MM), (0.1, 0, 0.2))
    there = S @ c.tool(S @ P @ S, S @ W_0 @ S, S @ W_1 @ S, S @ T @ S, _SCALE) @ S
    moved, turned = _between(c.tool(P, W_0, W_1, T, _SCALE), there)
    yield _point(
        "left_handed",
        "eq2",
        "in a left-handed scene (mirror S: p' = S p, R' = S R S) the motion is the mirror image",
        moved + np.radians(turned) * 1e-4,
        f"in a left-handed scene the tool ends {moved / _MM:.3f} mm and {turned:.3f} deg from the mirrored pose",
        "mirror both positions and rotations: p' = S p, R' = S R S",
    )


def _loop(c: Laws) -> tuple[list[Clause], Array]:
    """Move the hand once around a closed loop while it rotates, in many increments; return clauses and tool path."""
    k = np.arange(_INCREMENTS + 1)
    phase = 2 * np.pi * k / _INCREMENTS
    W = np.tile(np.eye(4), (len(k), 1, 1))
    W[:, :3, 3] = 50 * _MM * np.column_stack([np.cos(phase), np.sin(phase), 0.5 * np.sin(2 * phase)])
    W[:, :3, :3] = Rotation.from_rotvec(
        np.column_stack([0.6 * np.sin(phase), 0.4 * np.sin(2 * phase), 0.8 * (1 - np.cos(phase))])
    ).as_matrix()
    W[-1] = W[0]
    T = _pose((0, 0, 0), (0, 0, np.pi / 2))
    P = start = _pose((0, 40 * _MM, -90 * _MM), (0.1, 0.2, 0.3))
    path = [P[:3, 3]]
    for before, after in pairwise(W):
        P = c.tool(P, before, after, T, _SCALE)
        path.append(P[:3, 3])
    moved, turned = _between(start, P)
    way = "let the increments of a closed loop cancel: sum positions, multiply rotations in one frame"
    where = f"in {_INCREMENTS} increments"
    return [
        _point(
            "loop",
            "eq2",
            f"a closed path of the hand returns the tool to its position, {where}",
            moved,
            f"the hand returns after {_INCREMENTS} increments, and the tool is {number(moved / _MM)} mm from its start",
            way,
        ),
        _within(
            "loop.angle",
            "eq2",
            f"a closed path of the hand returns the tool to its orientation, {where}",
            turned,
            "deg",
            _ANGLE,
            f"the hand returns after {_INCREMENTS} increments, and the tool has turned {turned:.3g} deg",
            way,
        ),
    ], np.array(path)


# -- two hands, one camera ------------------------------------------------------------------------------------------


def _roll(c: Laws) -> Iterator[Clause]:
    n = np.array([0.0, 0, 1])
    in_angle = c.turn_unit == "rad"
    unit, factor = ("deg", 180 / np.pi) if in_angle else ("mm^2", 1e6)
    turn = Rotation.from_rotvec((0, 0, np.radians(3))).as_matrix()
    right, left = np.array([50, 20, 0]) * _MM, np.array([-50, -20, 0]) * _MM
    said = [factor * x for x in c.turns(right, turn @ right, left, turn @ left, n)]
    worst = min(said)
    yield Clause(
        "roll.direction",
        "eq4",
        "if the hands turn 3 deg counter-clockwise, the camera roll is positive",
        worst,
        unit,
        0.0,
        worst > 0,
        f"a hand at (50, 20, 0) mm that turns +3 deg (counter-clockwise) gives {said[0]:.0f} {unit}. The paper labels "
        "negative values clockwise: p1 x p0 points opposite to the axis of the turn from p0 to p1",
        "swap the factors: c = p0 x p1",
    )
    off = max(abs(x - 3) for x in said) if in_angle else worst
    yield _within(
        "roll.angle",
        "eq4",
        "if the hands turn 3 deg, the camera roll is 3 deg",
        off,
        unit,
        1e-9,
        (
            f"hands that turn 3 deg give {said[0]:.3f} and {said[1]:.3f} deg"
            if in_angle
            else "a cross product is an area and a displacement is a length: the paper prints no conversion to an angle"
        ),
        "roll = atan2((v0 x v1).n, v0.v1) with v = p_R - p_L",
        also=in_angle,
    )
    right, left, up = np.array([80, 0, 0]) * _MM, np.array([-80, 0, 0]) * _MM, np.array([0, 5, 0]) * _MM
    here = [factor * x for x in c.turns(right, right + up, left, left - up, n)]
    o = np.array([200, 0, 0]) * _MM
    there = [factor * x for x in c.turns(right + o, right + up + o, left + o, left - up + o, n)]
    off = max(abs(a - b) for a, b in zip(here, there, strict=True))
    yield _within(
        "roll.origin",
        "eq4",
        "the position of the origin has no effect on the roll",
        off,
        unit,
        1e-9,
        f"right hand +5 mm, left hand -5 mm: (c_zR, c_zL) = ({here[0]:+.0f}, {here[1]:+.0f}) {unit} with the hands at "
        f"+-80 mm, ({there[0]:+.0f}, {there[1]:+.0f}) {unit} with the origin shifted 200 mm"
        + (": the signs disagree" if there[0] * there[1] < 0 else ""),
        "use v = p_R - p_L, which does not depend on the origin",
    )
    lifted = [factor * x for x in c.turns(right, right + up, left, left + up, n)]
    off = max(map(abs, lifted))
    yield _within(
        "roll.lift",
        "eq4",
        "both hands moving up together do not roll the camera",
        off,
        unit,
        1e-9,
        f"both hands move up 5 mm: (c_zR, c_zL) = ({lifted[0]:+.0f}, {lifted[1]:+.0f}) {unit}, not zero; "
        "the paper states the condition 'parallel and discordant' only in words",
        "use v = p_R - p_L, which a common motion does not change",
    )
    wanted = np.degrees(np.arctan2(5, 80))
    off = max(abs(x - wanted) for x in here) if in_angle else max(map(abs, here))
    yield _within(
        "roll.opposed",
        "eq4",
        f"hands at +-80 mm that move +-5 mm roll the camera {wanted:.3f} deg",
        off,
        unit,
        1e-9,
        f"hands at +-80 mm that move +-5 mm give ({here[0]:+.4g}, {here[1]:+.4g}) {unit}, not {wanted:.3f} deg",
        "roll = atan2((v0 x v1).n, v0.v1) with v = p_R - p_L",
        also=in_angle,
    )


# -- forces, and the check of the paper itself ----------------------------------------------------------------------


def _force(c: Laws) -> Iterator[Clause]:
    rest, moving = abs(c.force(1 * _MM, 0.0)), abs(c.force(1e-9, 10 * _MM))
    yield _within(
        "force.units",
        "eq5",
        "stiffness and damping have units",
        0.0 if c.force_units else 1000.0,
        "times",
        1.0,
        f"the constants have no units: in N/mm, 1 mm gives {1e3 * rest:.0f} mN and 10 mm/s {1e3 * moving:.0f} mN; "
        f"in N/m, {rest:.1g} and {moving:.1g} mN, which is imperceptible",
        "state the units; N/mm and N s/mm give perceptible forces",
    )
    yield _within(
        "force.model",
        "eq5",
        "the model has the terms that its name implies",
        float("mass" in c.force_model),
        "terms missing",
        0.0,
        f"the paper calls it a {c.force_model} model, but no term contains a mass or an acceleration",
        "call the model a spring-damper, or add the term m d2x/dt2",
    )
    pulls = c.force(0.1 * _MM, -100 * _MM)
    yield _within(
        "force.pull",
        "eq5",
        "a surface never pulls inwards",
        max(pulls, 0.0),
        "N",
        0.0,
        f"at a depth of 0.1 mm, while it moves outwards at 100 mm/s, the tool is pulled inwards by {pulls:.2f} N",
        "set a force that points inwards to 0",
    )
    most = max(abs(c.force(depth * _MM, rate)) for depth in (1, 5, 10, 20) for rate in (-0.1, 0.0, 0.1))
    yield _within(
        "force.largest",
        "eq5",
        "no force exceeds the maximum force of the haptic pen",
        most,
        "N",
        _PEN,
        f"down to 20 mm depth the force reaches {most:.1f} N; a pen can apply {_PEN:g} N (ASSUMED)",
        f"limit the force to {_PEN:g} N, the maximum of the device",
    )
    off = max(abs(rest - 0.6), abs(moving - 0.1))
    yield _within(
        "force.size",
        "eq5",
        "a depth of 1 mm at rest gives 0.6 N; a rate of 10 mm/s at the surface gives 0.1 N",
        off,
        "N",
        1e-6,
        f"a depth of 1 mm at rest gives {rest:.3g} N; a rate of 10 mm/s at the surface gives {moving:.3g} N",
        "0.6 N/mm and 0.01 N s/mm",
    )


def _measure(c: Laws) -> Iterator[Clause]:
    T, P = _pose((0.1, 0, 0), (0, 0, np.pi / 2)), _pose((50 * _MM, 0, 0))
    W_0, W_1 = _pose((30 * _MM, 0, 0)), _pose((40 * _MM, 0, 0), (0, 0, 0.2))
    right = P.copy()
    right[:3, 3] += _SCALE * T[:3, :3] @ (W_1 - W_0)[:3, 3]
    right[:3, :3] = Rotation.from_rotvec(T[:3, :3] @ [0, 0, 0.2]).as_matrix() @ P[:3, :3]
    err = c.error(P, right, W_0, W_1, T, _SCALE)
    moved, turned = float(np.linalg.norm(err[:3, 3])), _angle(err[:3, :3])
    yield _point(
        "error.right",
        "eq7",
        "if the tool follows the hand exactly, the error is zero",
        moved,
        f"the tool follows the hand exactly, and eq. (7) gives {moved / _MM:.3f} mm and {turned:.3f} deg",
        "e_lin = dp - s R_T dh, e_ang = log(dR (R_T dR_H R_T^T)^T)",
    )
    T = _pose((0, 0, 0), (0, 0, np.pi / 2))
    wrong = T @ P  # result of the printed eqs (1) and (2) for a hand at rest
    gone = float(np.linalg.norm(wrong[:3, 3] - P[:3, 3]))
    shown = float(np.linalg.norm(c.error(P, wrong, W_0, W_0, T, _SCALE)[:3, 3]))
    off = abs(shown - gone)
    yield _point(
        "error.blind",
        "eq7",
        "if the tool moves while the hand is still, the error is this motion",
        off,
        f"the hand is still and the tool moves {gone / _MM:.3f} mm, as in the printed eqs (1), (2): eq. (7) gives "
        f"{shown / _MM:.3f} mm. Eq. (7) is circular: it compares eq. (2) with itself",
        "compare displacements of the tool with displacements of the hand, without eq. (2)",
    )


# -- helpers of the clauses ------------------------------------------------------------------------------------------


def _pose(p: Sequence[float], turn: Sequence[float] | Array = (0.0, 0.0, 0.0)) -> Array:
    """Return a pose (4, 4) from a position in m and a rotation vector in rad."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), p
    return out


def _shifted(W: Array, by: Array) -> Array:
    out = W.copy()
    out[:3, 3] += by
    return out


def _between(P: Array, Q: Array) -> tuple[float, float]:
    """Return (distance in m, angle in deg) between two poses."""
    return float(np.linalg.norm(Q[:3, 3] - P[:3, 3])), _angle(Q[:3, :3] @ P[:3, :3].T)


def _angle(R: Array) -> float:
    """Return the angle in deg of a rotation matrix; for any other matrix, the angle of the nearest rotation."""
    return float(np.degrees(Rotation.from_matrix(R).magnitude()))


def _point(name: str, equation: str, text: str, off: float, said: str, way: str) -> Clause:
    return Clause(name, equation, text, off / _MM, "mm", _POINT / _MM, off <= _POINT, said, way)


def _within(
    name: str, equation: str, text: str, value: float, unit: str, limit: float, said: str, way: str, also: bool = True
) -> Clause:
    """Return a clause that holds if `value` is at most `limit` and the condition `also` is true."""
    return Clause(name, equation, text, value, unit, limit, also and value <= limit, said, way)


def _triple(v: Array) -> str:
    return ", ".join(f"{x / _MM:.3f}" for x in v)
