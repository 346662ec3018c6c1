"""A four-bar finger in MJCF against a URDF whose mimic joints replace its loop."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import twin

C = np.array([0.02, 0.035])
E = np.array([-0.02, 0.004])
D = np.array([-0.003, 0.043])
"""Hinges of the finger (x, z) in m at zero; the driver turns about the origin."""

INERTIAL = '<inertial pos="0 0 0" mass="0.01" diaginertia="1e-5 1e-5 1e-5"/>'


def linkage(file: Path, d: np.ndarray) -> Path:
    """Write a finger: driver and rocker on the base, the tip on the driver, closed on the rocker at `d`."""
    tip = d - C
    file.write_text(
        f"""<mujoco><compiler angle="radian" autolimits="true"/><worldbody><body name="palm">{INERTIAL}
<body name="driver">{INERTIAL}<joint name="drive" axis="0 1 0" range="0 0.8"/>
<body name="tip" pos="{C[0]} 0 {C[1]}">{INERTIAL}<joint name="tip_hinge" axis="0 1 0"/></body></body>
<body name="rocker" pos="{E[0]} 0 {E[1]}">{INERTIAL}<joint name="rocker_hinge" axis="0 1 0"/></body>
</body></worldbody><equality><connect name="pin" body1="tip" body2="rocker" anchor="{tip[0]} 0 {tip[1]}"/></equality>
<actuator><position joint="drive"/></actuator></mujoco>""",
        encoding="utf-8",
    )
    return file


def coupled(file: Path) -> Path:
    """Write the same finger as URDF without its pin: the rocker turns as the driver, the tip keeps its direction."""
    limit = '<limit lower="-0.8" upper="0.8" effort="1" velocity="1"/>'
    joints = [
        ("finger_joint", "palm_link", "driver_link", (0.0, 0.0), ""),
        ("finger_tip_joint", "driver_link", "tip_link", C, '<mimic joint="finger_joint" multiplier="-1"/>'),
        ("rocker_joint", "palm_link", "rocker_link", E, '<mimic joint="finger_joint"/>'),
    ]
    lines = ['<robot name="finger"><link name="palm_link"/>']
    for name, parent, child, at, mimic in joints:
        lines.append(
            f'<link name="{child}"/><joint name="{name}" type="revolute"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="{at[0]} 0 {at[1]}"/><axis xyz="0 1 0"/>{limit}{mimic}</joint>'
        )
    file.write_text("\n".join([*lines, "</robot>"]), encoding="utf-8")
    return file


def turned(point: np.ndarray, angle: float) -> np.ndarray:
    """Return a point (x, z) turned about y."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * point[0] + s * point[1], -s * point[0] + c * point[1]])


def tip_angle(q: float) -> float:
    """Return by how much the tip of the linkage turns, from the triangle of its hinges."""
    at = turned(C, q)
    length = float(np.linalg.norm(D - C))

    def gap(rocker: float) -> float:
        return float(np.linalg.norm(E + turned(D - E, rocker) - at)) - length

    rocker = float(brentq(gap, q - 0.3, q + 0.3, xtol=1e-14))  # pyright: ignore[reportArgumentType]
    along = E + turned(D - E, rocker) - at
    before = D - C
    return float(np.arctan2(along[0] * before[1] - along[1] * before[0], along @ before))


def test_the_error_of_the_mimic_over_the_stroke_is_named(tmp_path: Path) -> None:
    files = linkage(tmp_path / "finger.xml", D), coupled(tmp_path / "finger.urdf")
    result = twin.compare(*files)
    (pair,) = result.pairs
    assert pair.mimic is not None
    assert pair.kinematics == "disagree"
    expected = [abs(tip_angle(q)) for q in np.linspace(0.0, 0.8, 81)]
    tip = next(link for link in pair.mimic.links if link.link == "tip_link")
    assert tip.angle == pytest.approx(max(expected), abs=1e-7)
    assert tip.at_angle == pytest.approx(0.01 * int(np.argmax(expected)), abs=1e-9)
    assert pair.mimic.stroke == (0.0, 0.8)
    assert pair.mimic.missing == ("pin",)
    (finding,) = [f for f in result.findings if f.code == "compare.mimic"]
    assert "tip_link" in finding.message
    # in the other order as well
    other = twin.compare(*reversed(files)).pairs[0].mimic
    assert other is not None
    assert other.worst.distance == pytest.approx(pair.mimic.worst.distance, abs=1e-9)


def test_the_mimic_of_a_parallelogram_is_right(tmp_path: Path) -> None:
    # the rocker is as long as the driver, and parallel to it
    files = linkage(tmp_path / "finger.xml", E + C), coupled(tmp_path / "finger.urdf")
    (pair,) = twin.compare(*files).pairs
    assert pair.mimic is not None
    assert pair.kinematics == "agree"
    assert pair.mimic.worst.distance < 1e-7


def test_a_pin_that_is_open_along_its_line_disagrees_with_a_right_mimic(tmp_path: Path) -> None:
    file = linkage(tmp_path / "finger.xml", E + C)
    text = file.read_text(encoding="utf-8")
    # two sites, of which that on the rocker lies 0.5 mm beside the plane of the linkage
    on_tip = f'<site name="on_tip" pos="{E[0]} 0 {E[1]}"/>'
    on_rocker = f'<site name="on_rocker" pos="{C[0]} 0.0005 {C[1]}"/>'
    hinges = ('<joint name="tip_hinge" axis="0 1 0"/>', '<joint name="rocker_hinge" axis="0 1 0"/>')
    for hinge, site in zip(hinges, (on_tip, on_rocker), strict=True):
        text = text.replace(hinge, hinge + site)
    start = text.index("<connect")
    end = text.index("/>", start)
    text = text[:start] + '<connect name="pin" site1="on_tip" site2="on_rocker"' + text[end:]
    file.write_text(text, encoding="utf-8")
    mimic = coupled(tmp_path / "finger.urdf")
    for sides in ((file, mimic), (mimic, file)):
        result = twin.compare(*sides)
        codes = [finding.code for finding in result.findings]
        assert "compare.link" in codes
        assert "compare.mimic" not in codes  # the couplings are right
        (pair,) = result.pairs
        assert pair.mimic is not None
        assert pair.kinematics == "disagree"
        (item,) = pair.differences
        assert item.text.startswith("joint 'pin' does not close its loop")
        assert item.shift == pytest.approx(0.0005, rel=1e-6)
