"""Robots as URDF: their links are boxes, the wrist has yaw, pitch and roll, and the tool is 0.1 m from the hand."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from twin.exchange.read import read
from twin.exchange.read.loop_closing import close
from twin.exchange.read.robot_folder import write_folder
from twin.model.mechanism import Mechanism

FORMULA = '''"""{about}"""

import numpy as np


def inverse(pose):
    R, p = pose[:3, :3], pose[:3, 3]
    yaw = np.arctan2(R[1, 0], R[0, 0])
    q5 = np.arctan2(-R[2, 0], np.sqrt(R[0, 0] ** 2 + R[1, 0] ** 2))
    q6 = np.arctan2(R[2, 1], R[2, 2])
    hand = p - 0.1 * R[:, 2]
    x = hand[0] - 0.05 * np.sin(q5) * np.cos(yaw)
    y = hand[1] - 0.05 * np.sin(q5) * np.sin(yaw)
    z = hand[2] - 0.05 * np.cos(q5)
{rows}'''
"""Equations of an arm that positions the wrist at x, y, z; `rows` compute the joints of the arm from x, y, z, yaw."""


def link(name: str, mass: float, size: tuple[float, float, float], at: tuple[float, float, float]) -> str:
    """Return a link that is a solid box: mass in kg, edge lengths `size` and centre `at` in m."""
    (x, y, z), k = size, mass / 12
    place = f'<origin xyz="{at[0]} {at[1]} {at[2]}"/>'
    shape = f'{place}<geometry><box size="{x} {y} {z}"/></geometry>'
    inertia = f'ixx="{k * (y * y + z * z)}" iyy="{k * (x * x + z * z)}" izz="{k * (x * x + y * y)}"'
    return (
        f'<link name="{name}"><visual>{shape}</visual><collision>{shape}</collision><inertial>{place}'
        f'<mass value="{mass}"/><inertia {inertia} ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def joint(
    name: str,
    kind: str,
    parent: str,
    child: str,
    at: str,
    axis: str,
    low: float,
    high: float,
    effort: float,
    more: str = "",
) -> str:
    """Return a driven joint: origin `at` in m, limits in m or rad, maximum effort in N or N m."""
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{at}"/><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" velocity="2" effort="{effort}"/>{more}</joint>'
    )


def robot(name: str, parts: Iterable[str]) -> str:
    """Return the URDF of a robot, with a link `tool` that is fixed to the link `hand`."""
    mount = '<joint name="mount" type="fixed"><origin xyz="0 0 0.1"/><parent link="hand"/><child link="tool"/></joint>'
    return "\n".join([f'<robot name="{name}">', *parts, '<link name="tool"/>', mount, "</robot>"])


def mechanism(text: str, path: Path) -> Mechanism:
    """Write a URDF to a path; return the mechanism read from it."""
    path.write_text(text)
    return close(read(path)).mechanism


def folder(text: str, path: Path, about: str, rows: str) -> Path:
    """Write a robot's folder with its equations; see `FORMULA`."""
    source = path.with_suffix(".urdf")
    source.write_text(text)
    write_folder(close(read(source)), path.name, path, source)
    (path / "formula.py").write_text(FORMULA.format(about=about, rows=rows))
    return path
