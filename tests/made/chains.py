"""Robots of one chain, given by joint lines at zero, with changed conventions, in four formats written by hand.

The USD has no tool frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from twin.core.spatial import euler_angles

FORMATS = ("urdf", "mjcf", "sdf", "usda")
SUFFIX = {"urdf": ".urdf", "mjcf": ".xml", "sdf": ".sdf", "usda": ".usda"}


@dataclass(frozen=True)
class Line:
    """A joint: name, whether it turns, its line and the frame (4, 4) of its link at zero in base, its limits."""

    name: str
    turns: bool
    point: np.ndarray
    axis: np.ndarray
    limits: tuple[float, float]
    frame: np.ndarray

    def local_axis(self) -> np.ndarray:
        return self.frame[:3, :3].T @ self.axis


@dataclass(frozen=True)
class Chain:
    """A robot: its joints from base to tool, and the tool frame (4, 4) at zero in base."""

    lines: tuple[Line, ...]
    tool: np.ndarray

    def names(self) -> list[str]:
        return [line.name for line in self.lines]


def motion(line: Line, q: float) -> np.ndarray:
    T = np.eye(4)
    if line.turns:
        T[:3, :3] = Rotation.from_rotvec(q * line.axis).as_matrix()
        T[:3, 3] = line.point - T[:3, :3] @ line.point
    else:
        T[:3, 3] = q * line.axis
    return T


def moved(line: Line, T: np.ndarray) -> Line:
    return replace(line, point=T[:3, :3] @ line.point + T[:3, 3], axis=T[:3, :3] @ line.axis, frame=T @ line.frame)


def chain(rows, tool) -> Chain:
    """Return a chain of rows (turns, point, axis)."""
    lines = []
    for i, (turns, point, axis) in enumerate(rows, 1):
        limits = (-1.4, 1.6) if turns else (-0.2, 0.3)
        frame = np.eye(4)
        frame[:3, 3] = point
        lines.append(Line(f"joint{i}", turns, np.array(point, float), np.array(axis, float), limits, frame))
    T = np.eye(4)
    T[:3, 3] = tool
    return Chain(tuple(lines), T)


X, Y, Z = np.eye(3)
ROBOTS = {
    "wrist_arm": chain(
        [
            (True, (0, 0, 0.1), Z), (True, (0.05, 0, 0.4), Y), (True, (0.05, 0, 0.8), Y),
            (True, (0.3, 0, 0.85), X), (True, (0.5, 0, 0.85), Y), (True, (0.6, 0, 0.85), X),
        ],
        (0.7, 0, 0.85),
    ),
    "offset_arm": chain(
        [
            (True, (0, 0, 0.1), Z), (True, (0, 0.13, 0.15), Y), (True, (0.6, 0.01, 0.15), Y),
            (True, (1.1, 0.13, 0.15), Y), (True, (1.1, 0.23, 0.15), -Z), (True, (1.1, 0.23, 0.05), Y),
        ],
        (1.1, 0.32, 0.05),
    ),
    "seven": chain(
        [
            (True, (0, 0, 0.15), Z), (True, (0, 0, 0.36), Y), (True, (0, 0, 0.56), Z), (True, (0, 0, 0.78), -Y),
            (True, (0, 0, 0.98), Z), (True, (0, 0, 1.18), Y), (True, (0, 0, 1.3), Z),
        ],
        (0, 0, 1.35),
    ),
    "scara": chain(
        [
            (True, (0, 0, 0.2), Z), (True, (0.35, 0, 0.2), Z), (False, (0.6, 0, 0.3), -Z), (True, (0.6, 0, 0.1), -Z),
        ],
        (0.6, 0, 0.05),
    ),
    "gantry": chain(
        [
            (False, (0, 0, 0.5), X), (False, (0, 0.1, 0.5), Y), (True, (0.1, 0.1, 0.4), Z), (True, (0.1, 0.15, 0.3), X),
            (True, (0.1, 0.2, 0.25), Y),
        ],
        (0.15, 0.2, 0.2),
    ),
}  # fmt: skip


def pose(rng: np.random.Generator, length: float, angle: float) -> np.ndarray:
    T = np.eye(4)
    direction = rng.normal(size=3)
    T[:3, :3] = Rotation.from_rotvec(angle * direction / np.linalg.norm(direction)).as_matrix()
    T[:3, 3] = rng.uniform(-length, length, 3)
    return T


def with_base(robot: Chain, T: np.ndarray) -> Chain:
    return Chain(tuple(moved(line, T) for line in robot.lines), T @ robot.tool)


def with_tool(robot: Chain, T: np.ndarray) -> Chain:
    return replace(robot, tool=robot.tool @ T)


def with_zero(robot: Chain, i: int, q: float) -> Chain:
    """Return the robot whose zero of joint i is where it was at q."""
    T = motion(robot.lines[i], q)
    lines = list(robot.lines)
    low, high = lines[i].limits
    lines[i] = replace(lines[i], limits=(low - q, high - q), frame=T @ lines[i].frame)
    for k in range(i + 1, len(lines)):
        lines[k] = moved(lines[k], T)
    return Chain(tuple(lines), T @ robot.tool)


def with_sign(robot: Chain, i: int) -> Chain:
    lines = list(robot.lines)
    low, high = lines[i].limits
    lines[i] = replace(lines[i], axis=-lines[i].axis, limits=(-high, -low))
    return replace(robot, lines=tuple(lines))


def with_names(robot: Chain) -> Chain:
    lines = [replace(line, name=f"axis_{chr(97 + i)}") for i, line in enumerate(robot.lines)]
    return replace(robot, lines=tuple(lines))


def write(robot: Chain, path: Path, kind: str) -> Path:
    """Write a chain in a format; return the path with its suffix."""
    path = path.with_suffix(SUFFIX[kind])
    poses = [line.frame for line in robot.lines]
    path.write_text({"urdf": _urdf, "mjcf": _mjcf, "sdf": _sdf, "usda": _usda}[kind](robot, poses))
    return path


def _text(values) -> str:
    return " ".join(f"{value + 0.0:.17g}" for value in values)


def _xyz_rpy(T: np.ndarray) -> tuple[str, str]:
    return _text(T[:3, 3]), _text(euler_angles(T[:3, :3], "zyx")[::-1])


def _quat(T: np.ndarray) -> str:
    return _text(np.roll(Rotation.from_matrix(T[:3, :3]).as_quat(), 1))


def _steps(robot: Chain, poses: list[np.ndarray]):
    above = np.eye(4)
    for line, T in zip(robot.lines, poses, strict=True):
        yield line, np.linalg.inv(above) @ T
        above = T


def _urdf(robot: Chain, poses: list[np.ndarray]) -> str:
    out = ['<robot name="made"><link name="base"/>']
    parent = "base"
    for i, (line, T) in enumerate(_steps(robot, poses), 1):
        xyz, rpy = _xyz_rpy(T)
        kind = "revolute" if line.turns else "prismatic"
        out += [
            f'<link name="link{i}"><inertial><mass value="1"/>',
            '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>',
            f'<joint name="{line.name}" type="{kind}"><parent link="{parent}"/><child link="link{i}"/>',
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{_text(line.local_axis())}"/>',
            f'<limit lower="{line.limits[0]}" upper="{line.limits[1]}" velocity="1" effort="1"/></joint>',
        ]
        parent = f"link{i}"
    xyz, rpy = _xyz_rpy(np.linalg.inv(poses[-1]) @ robot.tool)
    out += [
        f'<link name="tool"/><joint name="tool_joint" type="fixed"><parent link="{parent}"/><child link="tool"/>',
        f'<origin xyz="{xyz}" rpy="{rpy}"/></joint></robot>',
    ]
    return "\n".join(out)


def _mjcf(robot: Chain, poses: list[np.ndarray]) -> str:
    out = ['<mujoco model="made"><compiler angle="radian"/><worldbody><body name="base">']
    out.append('<geom type="sphere" size="0.01" mass="1"/>')
    for i, (line, T) in enumerate(_steps(robot, poses), 1):
        kind = "hinge" if line.turns else "slide"
        out += [
            f'<body name="link{i}" pos="{_text(T[:3, 3])}" quat="{_quat(T)}">',
            f'<joint name="{line.name}" type="{kind}" axis="{_text(line.local_axis())}" limited="true"',
            f' range="{_text(line.limits)}"/>',
            '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>',
        ]
    T = np.linalg.inv(poses[-1]) @ robot.tool
    out.append(f'<site name="tool" pos="{_text(T[:3, 3])}" quat="{_quat(T)}"/>')
    out.append("</body>" * (len(robot.lines) + 1))
    out.append("</worldbody></mujoco>")
    return "\n".join(out)


def _sdf(robot: Chain, poses: list[np.ndarray]) -> str:
    out = ['<sdf version="1.9"><model name="made"><link name="base"/>']
    parent = "base"
    for i, (line, T) in enumerate(zip(robot.lines, poses, strict=True), 1):
        xyz, rpy = _xyz_rpy(T)
        kind = "revolute" if line.turns else "prismatic"
        out += [
            f'<link name="link{i}"><pose>{xyz} {rpy}</pose><inertial><mass>1</mass></inertial></link>',
            f'<joint name="{line.name}" type="{kind}"><parent>{parent}</parent><child>link{i}</child>',
            f"<axis><xyz>{_text(line.local_axis())}</xyz><limit><lower>{line.limits[0]}</lower>",
            f"<upper>{line.limits[1]}</upper></limit></axis>",
            "</joint>",
        ]
        parent = f"link{i}"
    xyz, rpy = _xyz_rpy(np.linalg.inv(poses[-1]) @ robot.tool)
    out.append(f'<frame name="tool" attached_to="{parent}"><pose>{xyz} {rpy}</pose></frame></model></sdf>')
    return "\n".join(out)


def _usda(robot: Chain, poses: list[np.ndarray]) -> str:
    def placed(T: np.ndarray) -> list[str]:
        p = ", ".join(f"{v:.17g}" for v in T[:3, 3])
        q = ", ".join(_quat(T).split())
        return [
            f"double3 xformOp:translate = ({p})",
            f"quatd xformOp:orient = ({q})",
            'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]',
        ]

    out = [
        "#usda 1.0",
        '(\n defaultPrim = "made"\n metersPerUnit = 1\n kilogramsPerUnit = 1\n upAxis = "Z"\n)',
        'def Xform "made" (prepend apiSchemas = ["PhysicsArticulationRootAPI"]) {',
        'def Xform "base" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]) {\n'
        "float physics:mass = 1\n}",
        'def PhysicsFixedJoint "root" {\nrel physics:body1 = </made/base>\n}',
    ]
    parent = "base"
    above = np.eye(4)
    for i, (line, T) in enumerate(zip(robot.lines, poses, strict=True), 1):
        out.append(f'def Xform "link{i}" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]) {{')
        out += ["float physics:mass = 1", *placed(T)]
        out.append("}")
        kind = "Revolute" if line.turns else "Prismatic"
        factor = 180 / np.pi if line.turns else 1.0
        step = np.linalg.inv(above) @ T
        p = ", ".join(f"{v:.17g}" for v in step[:3, 3])
        turn = np.eye(4)
        turn[:3, :3] = Rotation.align_vectors([line.local_axis()], [Z])[0].as_matrix()
        q0 = ", ".join(_quat(step @ turn).split())
        q1 = ", ".join(_quat(turn).split())
        out += [
            f'def Physics{kind}Joint "{line.name}" {{',
            f"rel physics:body0 = </made/{parent}>\nrel physics:body1 = </made/link{i}>",
            f"point3f physics:localPos0 = ({p})\nquatf physics:localRot0 = ({q0})",
            f"point3f physics:localPos1 = (0, 0, 0)\nquatf physics:localRot1 = ({q1})",
            'uniform token physics:axis = "Z"',
            f"float physics:lowerLimit = {factor * line.limits[0]}",
            f"float physics:upperLimit = {factor * line.limits[1]}",
            "}",
        ]
        parent = f"link{i}"
        above = T
    out.append("}")
    return "\n".join(out)
