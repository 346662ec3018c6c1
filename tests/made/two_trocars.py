"""A robot with two trocars: two instruments that hold one needle, each through its own trocar, in a plane.

Each shaft turns about its trocar in the abdominal wall and is driven along its axis. A revolute joint connects the two
tips. The two slides therefore position the needle, and each instrument must follow the other.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from made import protocols
from made.mechanisms import box, solid
from twin.core import spatial
from twin.core.units import DEG, MM
from twin.model.body import Body, Frame, Point
from twin.model.joint import Drive, Joint
from twin.model.mechanism import Mechanism

NAME = "two_hands"
PLACES = {"left": np.array([-0.12, 0.0, 0.30]), "right": np.array([0.12, 0.0, 0.30])}
"""Positions (3,) in m of the trocars in base, as drawn, by name."""

NEEDLE = np.array([0.02, 0.0, 0.12])
"""Position (3,) in m in base at which the tips meet, as drawn."""

MOVED = {"left": np.array([-0.115, 0.0, 0.302]), "right": np.array([0.124, 0.0, 0.297])}
"""Positions (3,) in m of the trocars in base in the protocol `moved`, by name."""

_LENGTH = 0.34
"""Length of the shafts in m."""


def shaft_axis(trocar, tip=NEEDLE):
    """Return the direction of a shaft from its trocar to the tip."""
    return (tip - trocar) / np.linalg.norm(tip - trocar)


def theta(trocar, tip=NEEDLE):
    """Return the rotation of a shaft about y in rad: its z axis is (sin, 0, cos)."""
    n = shaft_axis(trocar, tip)
    return float(np.arctan2(n[0], n[2]))


def mechanism() -> Mechanism:
    """Return the robot as drawn, all bodies in base coordinates; it has shapes and masses."""
    wall = box("base_wall", [0, 0.05, 0.30], [0.4, 0.02, 0.05], (0.8, 0.7, 0.6, 1.0))
    bodies = [Body("base", (wall,), solid(5.0, [0, 0.05, 0.3], [0.4, 0.02, 0.05]))]
    turns, slides = [], []
    for i, (side, p) in enumerate(PLACES.items()):
        n, y = shaft_axis(p), 0.01 * (2 * i - 1)  # the two shafts are side by side
        R = spatial.frame_from_axes(n, [0, 1, 0])
        tube = box(f"tube_{side}_wall", [0, 0, 0], [0.02, 0.008, 0.02])
        rod = box(f"shaft_{side}_rod", [0, 0, 0], [0.004, 0.004, _LENGTH])
        for name, mesh, at, mass in (
            (f"tube_{side}", tube, p, 0.05),
            (f"shaft_{side}", rod, NEEDLE - 0.5 * _LENGTH * n, 0.1),
        ):
            there = type(mesh)(mesh.name, mesh.vertices @ R.T + at + [0, y, 0], mesh.triangles, mesh.color_rgba)
            size = np.ptp(mesh.vertices, axis=0)
            bodies.append(Body(name, (there,), solid(mass, at + np.array([0, y, 0]), size, R)))
        turn = spatial.pose(spatial.frame_from_axes([0, 1, 0], n), p)
        along = spatial.pose(R, p)
        turns.append(Joint(side, "revolute", "base", f"tube_{side}", turn, turn))
        slides.append(
            Joint(
                f"q_{side}",
                "prismatic",
                f"tube_{side}",
                f"shaft_{side}",
                along,
                along,
                active=True,
                limits=(-80 * MM, 80 * MM),
                max_speed=0.1,
                max_acceleration=0.5,
                drive=Drive(1e4, 500.0, 50.0),
            )
        )
    pin = spatial.pose(spatial.frame_from_axes([0, 1, 0], [1, 0, 0]), NEEDLE)
    n = shaft_axis(PLACES["left"])
    tool = spatial.pose(np.column_stack([np.cross([0, 1, 0], n), [0, 1, 0], n]), NEEDLE)
    return Mechanism(
        name=NAME,
        base="base",
        bodies=tuple(bodies),
        joints=(*turns, *slides, Joint("pin", "revolute", "shaft_left", "shaft_right", pin, pin)),
        frames=(Frame("base", "base", np.eye(4)), Frame("tool", "shaft_left", tool)),
        points=tuple(Point(f"at_{side}", f"tube_{side}", p) for side, p in PLACES.items()),
        rest={b.name: np.eye(4) for b in bodies},
        postures={"home": {"q_left": 0.0, "q_right": 0.0}},
        trocars=tuple(PLACES),
        source=f"{NAME}.py",
    )


def formula() -> str:
    """Return formula.py of the robot: two distances."""
    rows = [
        f'    "trocar_{side}_{axis}": mm({float(v / MM)!r}, "ASSUMED", "as drawn; a protocol places it"),'
        for side, p in PLACES.items()
        for axis, v in zip("xyz", p, strict=True)
    ]
    drawn = [
        f'    "out_{side}": mm({float(np.linalg.norm(NEEDLE - p) / MM)!r}, "ASSUMED", "trocar to tip as drawn"),'
        for side, p in PLACES.items()
    ]
    names = {s: ", ".join(f"trocar_{s}_{a}" for a in "xyz") for s in PLACES}
    return f'''"""Two instruments that hold one needle: the slides are the distances of the tip from the trocars."""

import numpy as np

from twin.formula import mm

PARAMETERS = {{
{chr(10).join(rows + drawn)}
}}


def inverse(pose, {names["left"]}, {names["right"]}, out_left, out_right):
    tip = pose[:3, 3]
    left = np.linalg.norm(tip - np.array([{names["left"]}]))
    right = np.linalg.norm(tip - np.array([{names["right"]}]))
    return left - out_left, right - out_right


def points(pose, {names["left"]}, {names["right"]}):
    return {{"at_left": np.array([{names["left"]}]), "at_right": np.array([{names["right"]}])}}
'''


LIMITS = (50, 200, 30, 120)


def protocol(name: str = "stitch", places=PLACES, stated=None, about: str = "left") -> str:
    """Return a protocol that moves the left instrument about a trocar: deeper, to the side, and back.

    Args:
        name: name of the protocol.
        places: positions (3,) in m of the trocars; the shafts of all poses pass through them.
        stated: positions in [trocars_mm], if they differ from `places`.
        about: name of the trocar in the phases.
    """
    first = theta(places["left"])
    depth = float(np.linalg.norm(NEEDLE - places["left"]))
    said = "\n".join(f"{n} = {[float(v) for v in np.round(p / MM, 9)]}" for n, p in (stated or places).items())
    patient = 'body = "abdomen"\nport = "trocar"\ntrocar = "right"\nprovenance = "ASSUMED"\nnote = "of a test"\n'
    head = {"name": name, "title": "Two instruments hold one needle", "robot": NAME, "start": "start"}
    turns = (("deep", first, depth + 0.02), ("side", first - 6 * DEG, depth - 0.015), ("back", first, depth))
    start = [float(v) for v in NEEDLE / MM]
    parts = [protocols.waypoint("start", (0, first / DEG, 0), position_mm=start)]
    parts += [protocols.waypoint(n, (0, turn / DEG, 0), depth_mm=deep / MM) for n, turn, deep in turns]
    parts += [
        protocols.phase(name=f"to_{n}", type="pivot", to=n, rcm="enforced", trocar=about)
        for n in ("deep", "side", "back")
    ]
    tables = f"\n[trocars_mm]\n{said}\n\n[patient]\n{patient}"
    return protocols.text(head, tables, {"pivot": LIMITS}, parts)


def write(folder: Path) -> Path:
    """Write the robot folder, with equations and the protocols `stitch` (trocars as drawn) and `moved`; return it."""
    from twin.exchange.read.imported_robot import Imported
    from twin.exchange.read.robot_folder import write_folder

    source = folder.parent / f"{NAME}.py"
    write_folder(Imported(mechanism(), []), NAME, folder, source)
    (folder / "formula.py").write_text(formula(), "utf-8")
    (folder / "trajectories/first.toml").unlink()
    (folder / "trajectories/stitch.toml").write_text(protocol(), "utf-8")
    (folder / "trajectories/moved.toml").write_text(protocol("moved", MOVED), "utf-8")
    description = folder / f"cad/{NAME}.toml"
    text = description.read_text("utf-8").replace('default_protocol = "first"', 'default_protocol = "stitch"')
    description.write_text(text, "utf-8")
    return folder
