"""Linkages with fewer than six degrees of freedom, drawn as STEP assemblies, like the export of another CAD program.

A body consists of the seats of its joints: a bore with a shoulder and a flat on the parent side, a journal with a
flange and a flat on the child side. All parts are drawn in world coordinates in mm; no instance has a placement.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
X, Y, Z = np.eye(3)


@dataclass(frozen=True)
class Pin:
    """A revolute joint between two bodies: position `at` (3,) in mm, direction `axis` (3,)."""

    parent: str
    child: str
    at: np.ndarray
    axis: np.ndarray


@dataclass(frozen=True)
class Linkage:
    """A linkage.

    Attributes:
        pins: revolute joints.
        driven: driven joints, as (parent, child).
        tool: body and position (3,) in mm of the tool.
        freedoms: degrees of freedom.
        slide: (parent, child, position in mm) of a body on two rails along x, or None.
        formula: text of formula.py; "" for a linkage without simple equations.
    """

    pins: tuple[Pin, ...]
    driven: tuple[tuple[str, str], ...]
    tool: tuple[str, np.ndarray]
    freedoms: int
    slide: tuple[str, str, np.ndarray] | None = None
    formula: str = ""


def elbow(a, b, la, lb, side):
    """Return the point (3,) in the plane z = 0 at distance `la` from a and `lb` from b; `side` (+1, -1) selects one."""
    d = np.linalg.norm(b - a)
    along = (d * d + la * la - lb * lb) / (2 * d)
    u = (b - a) / d
    return a + along * u + side * np.sqrt(la * la - along * along) * np.cross(Z, u)


def five_bar() -> Linkage:
    a1, a2, p = np.array([-40.0, 0, 0]), np.array([40.0, 0, 0]), np.array([10.0, 130, 0])
    b1, b2 = elbow(a1, p, 80, 110, 1), elbow(a2, p, 80, 110, -1)
    formula = f'''"""Five-bar: two driven cranks, and two rods that meet at the tool."""

import numpy as np

from twin.formula import mm, rad

PARAMETERS = {{
    "a": mm(40, "ASSUMED", "half the distance of the cranks"),
    "b": mm(80, "ASSUMED", "cranks"),
    "c": mm(110, "ASSUMED", "rods"),
    "zero_1": rad({np.arctan2(*(b1 - a1)[1::-1])!r}, "ASSUMED", "left crank as drawn"),
    "zero_2": rad({np.arctan2(*(b2 - a2)[1::-1])!r}, "ASSUMED", "right crank as drawn"),
}}


def inverse(x, y, a, b, c, zero_1, zero_2):
    r1, r2 = np.hypot(x + a, y), np.hypot(x - a, y)
    lift_1 = np.arccos((b**2 + r1**2 - c**2) / (2 * b * r1))
    lift_2 = np.arccos((b**2 + r2**2 - c**2) / (2 * b * r2))
    return np.arctan2(y, x + a) + lift_1 - zero_1, np.arctan2(y, x - a) - lift_2 - zero_2
'''
    pins = (
        Pin("base", "left", a1, Z),
        Pin("base", "right", a2, Z),
        Pin("left", "fore", b1, Z),
        Pin("right", "arm", b2, Z),
        Pin("fore", "arm", p, Z),
    )
    return Linkage(pins, (("base", "left"), ("base", "right")), ("fore", p), 2, formula=formula)


def slider_crank() -> Linkage:
    turned = np.radians(60)
    pin = 30 * np.array([np.cos(turned), np.sin(turned), 0])
    wrist = np.array([pin[0] + np.sqrt(100**2 - pin[1] ** 2), 0, 0])
    formula = f'''"""Slider-crank: a driven crank, a rod, a slider that carries the tool."""

import numpy as np

from twin.formula import mm, pose, rad

PARAMETERS = {{
    "r": mm(30, "ASSUMED", "crank"),
    "l": mm(100, "ASSUMED", "rod"),
    "zero": rad({turned!r}, "ASSUMED", "crank as drawn"),
}}


def forward(q, r, l, zero):
    angle = q[0] + zero
    return pose(np.eye(3), [r * np.cos(angle) + np.sqrt(l**2 - (r * np.sin(angle)) ** 2), 0, 0])
'''
    pins = (Pin("base", "crank", 0 * X, Z), Pin("crank", "rod", pin, Z), Pin("slider", "rod", wrist, Z))
    return Linkage(pins, (("base", "crank"),), ("slider", wrist), 1, ("base", "slider", wrist), formula)


def loop(lengths, twists, guess) -> list[Pin]:
    """Return the pins of a closed chain of links with Denavit-Hartenberg parameters.

    `lengths` in mm and `twists` in rad are a and alpha of each link. The angles are solved for, starting from `guess`
    in rad; the first angle is kept.
    """
    from scipy.optimize import least_squares

    n = len(lengths)

    def frames(angles):
        T, out = np.eye(4), []
        for a, alpha, theta in zip(lengths, twists, angles, strict=True):
            out.append(T.copy())
            (c, s), (ca, sa) = (np.cos(theta), np.sin(theta)), (np.cos(alpha), np.sin(alpha))
            T = T @ np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, 0], [0, 0, 0, 1]])
        return out, T

    def open_by(x):  # the first angle is fixed, because the chain can move
        T = frames([guess[0], *x])[1] - np.eye(4)
        return np.concatenate([T[:3, 3] / 50, T[:3, :3].ravel()])

    found = least_squares(open_by, guess[1:], xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert np.abs(found.fun).max() < 1e-11
    names = ["base", *(f"link{i}" for i in range(1, n))]
    Ts = frames([guess[0], *found.x])[0]
    return [Pin(names[(i - 1) % n], names[i], T[:3, 3], T[:3, 2]) for i, T in enumerate(Ts)]


def bennett() -> Linkage:
    alpha = np.radians(40)
    a, b = 80.0, 120.0
    beta = np.arcsin(b / a * np.sin(alpha))
    # cos and sin of the second angle follow from the first; the solver finds them
    pins = loop([a, b, a, b], [alpha, beta, alpha, beta], [1.2, 2.4, -1.2, -2.4])
    first, *others = pins  # `first` connects the last link with base
    pins = (*others[:1], *others[1:], first)
    return Linkage(tuple(pins), (("base", "link1"),), ("link2", pins[1].at + 10 * X), 1)


def bricard() -> Linkage:
    quarter = np.pi / 2
    t1 = np.radians(65)
    t2 = np.arccos(-np.cos(t1) / (1 + np.cos(t1)))
    pins = loop([70.0] * 6, [quarter, -quarter] * 3, [t1, t2] * 3)
    first, *others = pins
    return Linkage((*others, first), (("base", "link1"),), ("link3", others[2].at + 10 * Z), 1)


def sarrus() -> Linkage:
    pins = []
    for side, out, axis in (("a", X, Y), ("b", Y, X)):
        low, middle, high = 50 * out, 95 * out + 40 * Z, 50 * out + 80 * Z
        pins += [
            Pin("base", f"{side}_lower", low, axis),
            Pin(f"{side}_lower", f"{side}_upper", middle, axis),
            Pin(f"{side}_upper", "platform", high, axis),
        ]
    return Linkage(tuple(pins), (("base", "a_lower"),), ("platform", 80 * Z), 1)


def spherical() -> Linkage:
    pins = []
    for i, (u, w, v) in enumerate(((X, Z, Y), (Y, X, Z), (Z, Y, X)), 1):
        pins += [
            Pin("base", f"near{i}", 130 * u, u),
            Pin(f"near{i}", f"far{i}", 100 * w, w),
            Pin(f"far{i}", "platform", 70 * v, v),
        ]
    return Linkage(tuple(pins), tuple(("base", f"near{i}") for i in (1, 2, 3)), ("platform", 40 * (X + Y + Z)), 3)


LINKAGES: dict[str, Callable[[], Linkage]] = {
    f.__name__: f for f in (five_bar, slider_crank, bennett, bricard, sarrus, spherical)
}


def mechanism(linkage: Linkage, name: str):
    """Return the mechanism of a linkage without CAD: the same joints, and bodies without shapes."""
    from twin.core import spatial
    from twin.model.body import Body, Frame
    from twin.model.joint import Joint
    from twin.model.mechanism import Mechanism

    def frame(at, z):
        return spatial.pose(spatial.frame_from_axes(z, np.eye(3)[int(np.argmin(np.abs(z)))]), at / 1000)

    ends = [(p.parent, p.child, "revolute", frame(p.at, p.axis)) for p in linkage.pins]
    if linkage.slide is not None:
        parent, child, at = linkage.slide
        ends.append((parent, child, "prismatic", frame(at, X)))
    ends.sort(key=lambda e: e[:2] not in linkage.driven)
    joints = [
        Joint(f"j{i}", kind, parent, child, T, T, active=(parent, child) in linkage.driven)
        for i, (parent, child, kind, T) in enumerate(ends, 1)
    ]
    bodies = dict.fromkeys(b for e in ends for b in e[:2])
    tool = Frame("tool", linkage.tool[0], spatial.pose(p=linkage.tool[1] / 1000))
    rest = {b: np.eye(4) for b in bodies}
    return Mechanism(name, "base", tuple(map(Body, bodies)), tuple(joints), (tool,), rest=rest, source=f"{name}.py")


def draw(linkage: Linkage, path: Path) -> None:
    """Write the STEP assembly of a linkage; this takes seconds, because build123d is imported."""
    sys.path.insert(0, str(ROOT / "cad"))
    try:
        import drawing
        import shapes
    finally:
        sys.path.pop(0)
    from build123d import Plane, Solid

    tree: dict[str, list] = {"base": []}

    def add(body, solid):
        parts = tree.setdefault(body, [])
        parts.append((f"{body}_{len(parts) + 1}", drawing.bake(solid, np.eye(4))[0], (0.6, 0.65, 0.7)))

    for pin in linkage.pins:
        at, axis = tuple(map(float, pin.at)), tuple(map(float, pin.axis))
        across = np.eye(3)[int(np.argmin(np.abs(pin.axis)))]
        key = tuple(map(float, drawing.unit(across - (across @ pin.axis) * pin.axis)))
        add(pin.parent, shapes.seat(at, axis, 8.0, 4.0, 5.0, key=key))
        add(pin.child, shapes.flange(at, axis, 8.0, 4.0, 4.0, 5.0, key=key))
    if linkage.slide is not None:
        parent, child, at = linkage.slide
        x0 = float(at[0]) - 20
        block = Solid.make_box(40, 60, 10, Plane(origin=(x0, -30, -25)))
        for y in (-20.0, 20.0):
            block -= shapes.cyl((x0 - 1, y, -20), tuple(X), 3.02, 42)
            add(parent, shapes.cyl((x0, y, -20), tuple(X), 3.0, 90))
        add(child, block)
        add(parent, Solid.make_box(10, 60, 10, Plane(origin=(x0 + 90, -30, -25))))
    drawing.write_step(tree, path, path.stem)


def finish(description: Path, linkage: Linkage) -> None:
    """Edit the description written by `twin new`, like its user.

    The proposed joints are uncommented, the driven joints are marked, and the temporary fixed joints are deleted.
    """
    text = description.read_text("utf-8")
    text = re.sub(r"^# (\[\[joint\]\]|(?:name|type|parent|child|on_parent|on_child) = )", r"\1", text, flags=re.M)
    text = re.sub(r"\n\[\[joint\]\]\nname = \"hold_.*?(?=\n\n)", "", text, flags=re.S)
    material = re.compile(r"^# \[material.*?(?=\n\n)", flags=re.M | re.S)
    text = material.sub(lambda m: m[0].replace("# [", "[").replace("\n# ", "\n"), text)
    blocks = re.split(r"(?=\n\[\[joint\]\]\n)", text)
    joints = [b for b in blocks if b.startswith("\n[[joint]]")]
    driven = []
    for block in joints:
        ends = tuple(re.findall(r'^(?:parent|child) = "(\w+)"', block, flags=re.M))
        if ends in linkage.driven or ends[::-1] in linkage.driven:
            driven.append(block)
    assert len(driven) == len(linkage.driven)
    text = text.replace(f'body = "{_tool(text)}"', f'body = "{linkage.tool[0]}"')
    place = ", ".join(repr(float(v)) for v in linkage.tool[1])
    text = re.sub(r"(\[frame\.tool\].*?position_mm = )\[.*?\]", rf"\g<1>[{place}]", text, flags=re.S)
    drives = re.compile(r"^# \[\[drive\]\].*?(?=\n\n)", flags=re.M | re.S)
    names = ", ".join('"' + re.search(r'^name = "(\w+)"', b, flags=re.M)[1] + '"' for b in driven)
    uncommented = drives.search(text)[0].removeprefix("# ").replace("\n# ", "\n").replace('"NAME"', names)
    text = drives.sub(lambda _: uncommented, text)
    for block in driven:
        name = re.search(r'^name = "(\w+)"', block, flags=re.M)[1]
        text = text.replace(block, block.replace(f'name = "{name}"\n', f'name = "{name}"\nactive = true\n'))
        unit = "mm" if 'type = "prismatic"' in block else "deg"
        text = text.rstrip("\n") + f"\n{name}_{unit} = 0\n"
    description.write_text(text, "utf-8")


def _tool(text: str) -> str:
    return re.search(r"\[frame\.tool\].*?body = \"(\w+)\"", text, flags=re.S)[1]
