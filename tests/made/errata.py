"""The entries of tests/kinerrata as files: the robot with the wrong numbers, corrected, and in another format.

Plain code writes URDF, xacro, MJCF and tables of Denavit-Hartenberg parameters; nothing of twin takes part, except that
it makes the folder around a formula.
"""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from twin.exchange.read import read
from twin.exchange.read.robot_folder import write_folder

FOLDER = Path(__file__).parents[1] / "kinerrata"

PLACES: dict[str, tuple[str, int | None]] = {
    **{f"origin {x}": ("xyz", i) for i, x in enumerate("xyz")},
    **{f"origin {x}": ("rpy", i) for i, x in enumerate(("roll", "pitch", "yaw"))},
    **{f"axis {x}": ("axis", i) for i, x in enumerate("xyz")},
    **{f"centre {x}": ("centre", i) for i, x in enumerate("xyz")},
    **{f"inertia {x}": ("inertia", i) for i, x in enumerate(("xx", "yy", "zz", "xy", "xz", "yz"))},
    **{x: (x, None) for x in ("lower", "upper", "velocity", "effort", "multiplier", "offset", "mass")},
    **{x: (x, None) for x in ("a", "alpha", "d", "theta")},
}
"""{last words of a place: (what they name in a joint, body or row, component of it)}."""

SPEED = 2.0
EFFORT = 100.0
"""Speed in rad/s or m/s and effort in N m or N of joints for which an entry states none: URDF demands both."""

Table = dict[str, Any]
"""A joint, body or row of an entry, as in its file."""


@dataclass(frozen=True)
class WrongNumber:
    """A number of an entry.

    Attributes:
        owner: name of its joint, body or row.
        key, component: where it is in the owner: ("xyz", 2), or ("mass", None).
        before, after: its values, in SI units.
    """

    owner: str
    key: str
    component: int | None
    before: float
    after: float


@dataclass(frozen=True)
class EntryRobot:
    """A robot of an entry: joints with bodies, or the rows of a table with its convention."""

    name: str
    joints: tuple[Table, ...] = ()
    bodies: tuple[Table, ...] = ()
    rows: tuple[Table, ...] = ()
    convention: str = ""

    def without(self, names: Sequence[str]) -> EntryRobot:
        """Return the robot without the joints or rows of these names; nothing may be behind them."""
        joints = tuple(joint for joint in self.joints if joint["name"] not in names)
        rows = tuple(row for row in self.rows if row["name"] not in names)
        return replace(self, joints=joints, rows=rows)


@dataclass(frozen=True)
class Entry:
    """An entry of tests/kinerrata.

    Attributes:
        name: name of its file.
        data: its content.
        numbers: its numbers, those that belong to a joint, body or row.
    """

    name: str
    data: Table = field(repr=False)
    numbers: tuple[WrongNumber, ...]

    @property
    def kind(self) -> str:
        """What kind of error it is, or "false alarm"."""
        return self.data["kind"]

    @property
    def accused(self) -> bool:
        """Whether one of its two robots is wrong."""
        return self.data["accused"]

    @property
    def alone(self) -> bool:
        """Whether the entry has one robot only, as its right or its other numbers are not known."""
        stated = ("order_before", "absent_before", "convention_before")
        if self.numbers or any(key in self.data for key in stated):
            return False
        return not ("joint" in self.data and "dh" in self.data)

    @property
    def equation(self) -> bool:
        """Whether the error stands in a formula: `write_formula` writes it, and `write` does not."""
        return "equation" in self.data

    @property
    def left_out(self) -> str:
        """Why no file can be written, or ""."""
        if "chain" not in self.data:
            return "it has no chain: an equation, a name, or a number whose robot is not known"
        if self.equation:
            return ""
        if self.alone and self.accused and not self.data.get("body"):
            return "its wrong numbers are not given"
        return ""

    def after(self) -> EntryRobot:
        """Return the corrected robot; of an entry with one robot only, that robot."""
        joints = tuple(copy.deepcopy(self.data.get("joint", [])))
        if joints and all(joint["type"] == "fixed" for joint in joints):
            joints = (_turntable(joints[0]["parent"]), *joints)
        bodies = tuple(copy.deepcopy(self.data.get("body", [])))
        if joints:
            return EntryRobot(self.name, joints, bodies)
        rows = tuple(copy.deepcopy(self.data["dh"]))
        return EntryRobot(self.name, (), bodies, rows, self.data["convention"])

    def before(self) -> EntryRobot:
        """Return the wrong robot; of a false alarm, the other of the two that are right."""
        robot = self.after()
        if robot.joints and "dh" in self.data:
            rows = tuple(copy.deepcopy(self.data["dh"]))
            return EntryRobot(self.name, (), (), rows, self.data["convention"])
        owners = {owner["name"]: owner for owner in (*robot.joints, *robot.bodies, *robot.rows)}
        for number in self.numbers:
            owner = owners[number.owner]
            if number.component is None:
                owner[number.key] = number.before
            else:
                owner[number.key][number.component] = number.before
        robot = robot.without(self.data.get("absent_before", ()))
        robot = replace(robot, convention=self.data.get("convention_before", robot.convention))
        if "order_before" in self.data:
            robot = _ordered(robot, self.data["order_before"], chained=self.kind == "joint order")
        return robot


@dataclass(frozen=True)
class EntryFiles:
    """The files of an entry.

    Attributes:
        before: the wrong robot, or the other of two that are right; None if there is one robot only, and it is right.
        after: the corrected robot; None if the right numbers are not known.
        second: the corrected robot in another format; None without `after`.
    """

    before: Path | None
    after: Path | None
    second: Path | None


def entries() -> list[Entry]:
    """Return all entries, by name."""
    return [entry(path.stem) for path in sorted(FOLDER.glob("*.toml"))]


def entry(name: str) -> Entry:
    """Return one entry."""
    data = tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))
    numbers = []
    if "chain" in data:
        for number in data.get("number", []):
            numbers.append(_number(number))
    return Entry(name, data, tuple(numbers))


def _number(number: Mapping[str, Any]) -> WrongNumber:
    place = number["place"]
    for end, (key, component) in PLACES.items():
        if place.endswith(f" {end}"):
            return WrongNumber(place.removesuffix(f" {end}"), key, component, number["before"], number["after"])
    raise ValueError(f"{place}: no joint, body or row has such a number")


def write(entry: Entry, folder: Path) -> EntryFiles:
    """Write the files of an entry into a folder of its own."""
    folder.mkdir(parents=True)
    robot = entry.after()
    before = None
    after = None
    second = None
    right = not (entry.alone and entry.accused)
    if entry.accused or not entry.alone:
        before = _write_as(_format(entry, entry.before()), entry.before(), folder / "before")
    if right:
        after = _write_as(_format(entry, robot), robot, folder / "after")
        other = "mjcf" if _format(entry, robot) == "urdf" else "urdf"
        second = _write_as(other, robot, folder / "second")
    return EntryFiles(before, after, second)


def write_formula(entry: Entry, folder: Path, corrected: bool) -> Path:
    """Write the robot of an entry as a folder with its wrong or its corrected formula; return the folder."""
    folder.mkdir(parents=True)
    table = folder / f"{entry.name}.csv"
    table.write_text(table_text(entry.after()), encoding="utf-8")
    robot = folder / entry.name
    write_folder(read(table), entry.name, robot, table)
    equation = entry.data["equation"]
    statement = equation["after" if corrected else "before"]
    text = equation["formula"].lstrip().replace("{statement}", statement)
    (robot / "formula.py").write_text(text, encoding="utf-8")
    return robot


def _format(entry: Entry, robot: EntryRobot) -> str:
    """Return the format of a robot: that of the entry; a table only without bodies, which it cannot state."""
    if robot.rows and not robot.bodies:
        return "dh"
    return entry.data.get("format", "urdf")


def _write_as(format: str, robot: EntryRobot, path: Path) -> Path:
    if format == "dh":
        path = path.with_suffix(".csv")
        path.write_text(table_text(robot), encoding="utf-8")
        return path
    if robot.rows:
        robot = chain_of(robot)
    if format == "mjcf":
        path = path.with_suffix(".xml")
        path.write_text(mjcf_text(robot), encoding="utf-8")
        return path
    path = path.with_suffix(".urdf")
    path.write_text(urdf_text(robot), encoding="utf-8")
    return path


# -- robots -------------------------------------------------------------------------------------------


def _turntable(link: str) -> Table:
    """Return a joint under a part of a robot that has none: a mechanism needs one."""
    place = {"xyz": [0, 0, 0], "rpy": [0, 0, 0], "axis": [0, 0, 1]}
    return {"name": "turntable", "type": "continuous", "parent": "stand", "child": link, **place}


def _pose(joint: Table) -> np.ndarray:
    """Return the pose (4, 4) of the child of a joint in its parent at zero."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", joint["rpy"]).as_matrix()
    T[:3, 3] = joint["xyz"]
    return T


def _placed(joint: Table, T: np.ndarray) -> Table:
    """Return the joint with the pose T (4, 4) as origin."""
    R = T[:3, :3]
    pitch = np.arctan2(-R[2, 0], np.hypot(R[2, 1], R[2, 2]))
    if np.hypot(R[2, 1], R[2, 2]) > 1e-9:
        roll = np.arctan2(R[2, 1], R[2, 2])
        yaw = np.arctan2(R[1, 0], R[0, 0])
    else:  # at a pitch of 90 degrees, roll and yaw are turns about one line
        roll = 0.0
        yaw = np.arctan2(-R[0, 1], R[1, 1])
    return {**joint, "xyz": [float(x) + 0.0 for x in T[:3, 3]], "rpy": [float(x) + 0.0 for x in (roll, pitch, yaw)]}


def _ordered(robot: EntryRobot, order: Sequence[str], chained: bool) -> EntryRobot:
    """Return the robot with its joints in another order.

    With `chained`, the joints follow each other in this order, and each keeps its line in space at zero; else only the
    order of the file changes.
    """
    joints = {joint["name"]: joint for joint in robot.joints}
    if not chained:
        others = [name for name in joints if name not in order]
        return replace(robot, joints=tuple(joints[name] for name in (*others, *order)))
    T_base_joint: dict[str, np.ndarray] = {}
    T_base_link = {robot.joints[0]["parent"]: np.eye(4)}
    for joint in robot.joints:
        T_base_joint[joint["name"]] = T_base_link[joint["parent"]] @ _pose(joint)
        T_base_link[joint["child"]] = T_base_joint[joint["name"]]
    parent = robot.joints[0]["parent"]
    T_base_parent = np.eye(4)
    chain = []
    for name in order:
        placed = _placed(joints[name], np.linalg.inv(T_base_parent) @ T_base_joint[name])
        chain.append({**placed, "parent": parent})
        parent = placed["child"]
        T_base_parent = T_base_joint[name]
    return replace(robot, joints=tuple(chain))


def _elementary(motion: str, size: float) -> np.ndarray:
    """Return a turn ("Rx") or a shift ("Tz") as a matrix (4, 4)."""
    T = np.eye(4)
    axis = "xyz".index(motion[1])
    if motion[0] == "T":
        T[axis, 3] = size
        return T
    T[:3, :3] = Rotation.from_rotvec(size * np.eye(3)[axis]).as_matrix()
    return T


def chain_of(robot: EntryRobot) -> EntryRobot:
    """Return the robot of a table as joints and links: link0, link1, ... have the frames of the convention.

    In a standard table these frames are behind the joints: there each joint has a link of its own, joint1, joint2, ...
    """
    standard = robot.convention == "standard"
    joints: list[Table] = []
    for i, row in enumerate(robot.rows, 1):
        kind = row.get("type", "revolute")
        theta = row["theta"]
        d = row["d"]
        if kind == "prismatic":
            d += row.get("offset", 0.0)
        else:
            theta += row.get("offset", 0.0)
        along_x = _elementary("Tx", row["a"]) @ _elementary("Rx", row["alpha"])
        along_z = _elementary("Rz", theta) @ _elementary("Tz", d)
        child = f"joint{i}" if standard else f"link{i}"
        joint = {"name": row["name"], "type": kind, "parent": f"link{i - 1}", "child": child}
        if kind != "fixed":
            joint["axis"] = [0, 0, 1]
        if not standard:
            joints.append(_placed(joint, along_x @ along_z))
            continue
        joints.append(_placed(joint, np.eye(4)))
        frame = {"name": f"{row['name']}-frame", "type": "fixed", "parent": child, "child": f"link{i}"}
        joints.append(_placed(frame, along_z @ along_x))
    return EntryRobot(robot.name, tuple(joints), robot.bodies)


def _links(robot: EntryRobot) -> list[str]:
    links: list[str] = []
    for joint in robot.joints:
        for link in (joint["parent"], joint["child"]):
            if link not in links:
                links.append(link)
    return links


def _numbers(values: Sequence[float]) -> str:
    return " ".join(str(value) for value in values)


# -- URDF and xacro -----------------------------------------------------------------------------------


def urdf_text(robot: EntryRobot) -> str:
    """Return the robot as URDF."""
    return "\n".join([f'<robot name="{robot.name}">', *_urdf_lines(robot), "</robot>"]) + "\n"


def _urdf_lines(robot: EntryRobot) -> list[str]:
    bodies = {body["name"]: body for body in robot.bodies}
    lines: list[str] = []
    for link in _links(robot):
        if link not in bodies:
            lines.append(f'  <link name="{link}"/>')
            continue
        body = bodies[link]
        names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        moments = " ".join(f'{name}="{value}"' for name, value in zip(names, body["inertia"], strict=True))
        lines += [
            f'  <link name="{link}">',
            "    <inertial>",
            f'      <origin xyz="{_numbers(body["centre"])}"/>',
            f'      <mass value="{body["mass"]}"/>',
            f"      <inertia {moments}/>",
            "    </inertial>",
            "  </link>",
        ]
    for joint in robot.joints:
        lines += _urdf_joint(joint)
    return lines


def _urdf_joint(joint: Table) -> list[str]:
    kind = joint["type"]
    if kind == "revolute" and "lower" not in joint:
        kind = "continuous"  # the entry states no limits, without which a revolute joint is no URDF
    lines = [
        f'  <joint name="{joint["name"]}" type="{kind}">',
        f'    <origin xyz="{_numbers(joint["xyz"])}" rpy="{_numbers(joint["rpy"])}"/>',
        f'    <parent link="{joint["parent"]}"/>',
        f'    <child link="{joint["child"]}"/>',
    ]
    if kind == "fixed":
        return [*lines, "  </joint>"]
    lines.append(f'    <axis xyz="{_numbers(joint["axis"])}"/>')
    limit = f'effort="{joint.get("effort", EFFORT)}" velocity="{joint.get("velocity", SPEED)}"'
    if kind == "revolute" or (kind == "prismatic" and "lower" in joint):
        limit = f'lower="{joint["lower"]}" upper="{joint["upper"]}" {limit}'
    lines.append(f"    <limit {limit}/>")
    if "mimic" in joint:
        ratio = f'multiplier="{joint["multiplier"]}" offset="{joint["offset"]}"'
        lines.append(f'    <mimic joint="{joint["mimic"]}" {ratio}/>')
    return [*lines, "  </joint>"]


HEAD = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"'


def written(name: str, folder: Path, corrected: bool) -> Path:
    """Write the robot of an entry as a xacro with a macro in a file of its own; return the file to read."""
    known = entry(name)
    robot = known.after() if corrected else known.before()
    lines = [f"{HEAD}>", '<xacro:macro name="arm" params="">', *_urdf_lines(robot), "</xacro:macro>", "</robot>"]
    folder.mkdir(parents=True)
    macro = folder / f"{name}_macro.xacro"
    macro.write_text("\n".join(lines) + "\n", encoding="utf-8")
    path = folder / f"{name}.urdf.xacro"
    call = f'{HEAD} name="{name}">\n<xacro:include filename="{macro.name}"/>\n<xacro:arm/>\n</robot>\n'
    path.write_text(call, encoding="utf-8")
    return path


# -- MJCF ---------------------------------------------------------------------------------------------


def mjcf_text(robot: EntryRobot) -> str:
    """Return the robot as MJCF, angles in degrees; MuJoCo gives links without a mass one of a milligram."""
    lines = [
        f'<mujoco model="{robot.name}">',
        '  <compiler angle="degree" autolimits="true" boundmass="1e-6" boundinertia="1e-12"/>',
        "  <worldbody>",
    ]
    children = {joint["child"] for joint in robot.joints}
    for link in _links(robot):
        if link in children:
            continue
        if link == "world":  # it has this name in MJCF as well, and is no body there
            for joint in robot.joints:
                if joint["parent"] == link:
                    lines += _mjcf_body(robot, joint["child"], joint, "    ")
            continue
        lines += _mjcf_body(robot, link, None, "    ")
    lines.append("  </worldbody>")
    followers = [joint for joint in robot.joints if "mimic" in joint]
    if followers:
        lines.append("  <equality>")
        for joint in followers:
            ratio = f'polycoef="{joint["offset"]} {joint["multiplier"]} 0 0 0"'
            lines.append(f'    <joint joint1="{joint["name"]}" joint2="{joint["mimic"]}" {ratio}/>')
        lines.append("  </equality>")
    return "\n".join([*lines, "</mujoco>"]) + "\n"


def _mjcf_body(robot: EntryRobot, link: str, joint: Table | None, indent: str) -> list[str]:
    """Return the lines of a body, its joint to the parent, and all bodies on it."""
    place = ""
    if joint is not None:
        x, y, z, w = Rotation.from_euler("xyz", joint["rpy"]).as_quat()
        place = f' pos="{_numbers(joint["xyz"])}" quat="{_numbers([w, x, y, z])}"'
    lines = [f'{indent}<body name="{link}"{place}>']
    if joint is not None and joint["type"] != "fixed":
        lines.append(f"{indent}  {_mjcf_joint(joint)}")
    for body in robot.bodies:
        if body["name"] == link:
            moments = _numbers(body["inertia"])
            centre = _numbers(body["centre"])
            lines.append(f'{indent}  <inertial pos="{centre}" mass="{body["mass"]}" fullinertia="{moments}"/>')
    for other in robot.joints:
        if other["parent"] == link:
            lines += _mjcf_body(robot, other["child"], other, indent + "  ")
    return [*lines, f"{indent}</body>"]


def _mjcf_joint(joint: Table) -> str:
    slides = joint["type"] == "prismatic"
    kind = "slide" if slides else "hinge"
    text = f'<joint name="{joint["name"]}" type="{kind}" axis="{_numbers(joint["axis"])}"'
    if joint["type"] != "continuous" and "lower" in joint:
        limits = [joint["lower"], joint["upper"]]
        if not slides:
            limits = np.degrees(limits).tolist()
        text += f' range="{_numbers(limits)}"'
    return text + "/>"


# -- tables -------------------------------------------------------------------------------------------


def table_text(robot: EntryRobot) -> str:
    """Return the table of a robot as CSV, with its convention and units."""
    limits = ("lower", "upper") if all("lower" in row for row in robot.rows) else ()
    headings = ("joint", "type", "a", "alpha", "d", "theta", "offset", *limits)
    lines = [f"# convention: {robot.convention}", "# units: m, rad", ",".join(headings)]
    for row in robot.rows:
        values = [row[key] for key in ("a", "alpha", "d", "theta")]
        cells = [row["name"], row.get("type", "revolute"), *values, row.get("offset", 0)]
        cells += [row[key] for key in limits]
        lines.append(",".join(str(cell) for cell in cells))
    return "\n".join(lines) + "\n"
