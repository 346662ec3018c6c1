"""Read a table of Denavit-Hartenberg parameters: a mechanism, and its equations as the text of a formula.py.

The mechanism is computed here, the equations are written as products of the four elementary motions; `twin validate`
compares the two.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.toml_text import one_line
from twin.exchange.formats.dh.table import CellQuantity, DhRow, DhTable, read_table
from twin.exchange.read.imported_robot import Findings, Imported, Names, Options, assemble
from twin.model.body import Body, Frame
from twin.model.joint import Joint, JointType

Step = tuple[str, str]
"""An elementary motion of a row: ("Rx", "alpha"). R turns about the axis, T moves along it."""

_BEFORE: dict[str, tuple[Step, ...]] = {
    "standard": (),
    "modified": (("Rx", "alpha"), ("Tx", "a"), ("Rz", "theta"), ("Tz", "d")),
    "khalil": (("Rz", "gamma"), ("Tz", "b"), ("Rx", "alpha"), ("Tx", "d"), ("Rz", "theta"), ("Tz", "r")),
    "hayati": (),
}
"""Constant motions of a row before that of its joint, whose axis is z."""

_AFTER: dict[str, tuple[Step, ...]] = {
    "standard": (("Rz", "theta"), ("Tz", "d"), ("Tx", "a"), ("Rx", "alpha")),
    "modified": (),
    "khalil": (),
    "hayati": (("Rz", "theta"), ("Tz", "d"), ("Tx", "a"), ("Rx", "alpha"), ("Ry", "beta")),
}
"""Constant motions of a row after that of its joint. Turns about z and moves along z can be exchanged."""

_COORDINATE: Step = ("", "")
"""The motion of the joint."""

_TITLES = {
    "standard": "standard (distal)",
    "modified": "modified (proximal, Craig)",
    "khalil": "Khalil-Kleinfinger",
    "hayati": "Hayati",
}

_LINE_LENGTH = 120
"""Longest line of the text of a formula.py."""

_TYPES: dict[str, JointType] = {"revolute": "revolute", "prismatic": "prismatic", "fixed": "fixed"}


def read(path: Path, options: Options) -> Imported:
    """Return the mechanism of a table, with its equations.

    Bodies are link0 (the base) to link<n>, with the frames of the convention; the tool is the last frame.

    Raises:
        SourceError: the table cannot be read, or lacks its convention or units.
    """
    table = read_table(path, options.dh)
    findings = Findings()
    for text in table.assumptions:
        findings.warn("dh", text, path.name)
    findings.note("dh", f"The convention of the table is {_TITLES[table.convention]}.", path.name)
    labels: list[str] = []
    for number, row in enumerate(table.rows):
        labels.append(row.name or f"q{number + 1}")
    # A table may repeat a name, as of two arms; then the joints are numbered.
    names = Names("joint", labels, findings) if len(set(labels)) == len(labels) else None
    bodies = [Body("link0")]
    joints: list[Joint] = []
    for number, (row, label) in enumerate(zip(table.rows, labels, strict=True)):
        name = names[label] if names is not None else f"q{number + 1}"
        T_parent_joint = _product(row, _BEFORE[table.convention])
        T_joint_child = _product(row, _AFTER[table.convention])
        child = f"link{number + 1}"
        bodies.append(Body(child))
        joints.append(
            Joint(
                name,
                _TYPES[row.kind],
                bodies[number].name,
                child,
                T_parent_joint,
                spatial.inverse(T_joint_child),
                active=row.kind != "fixed",
                limits=row.limits,
            )
        )
    tool = Frame("tool", bodies[-1].name, np.eye(4))
    imported = assemble(path, path.stem, "link0", bodies, joints, [tool], (), findings)
    imported.formula = equations(path, table, joints)
    return imported


def _product(row: DhRow, steps: Sequence[Step]) -> Array:
    T = np.eye(4)
    for motion, parameter in steps:
        value = 0.0
        if parameter in row.values:
            value = row.values[parameter].value
        T = T @ _motion(motion, value)
    return T


def _motion(motion: str, value: float) -> Array:
    """Return the pose (4, 4) of a turn such as "Rx" by a value in rad, or of a move such as "Tz" by one in m."""
    axis = np.eye(3)["xyz".index(motion[1])]
    if motion[0] == "R":
        return spatial.pose(spatial.exp_so3(value * axis))
    return spatial.pose(p=value * axis)


def equations(path: Path, table: DhTable, joints: Sequence[Joint]) -> str:
    """Return the text of a formula.py: parameters with the lines of the table, and the product of its rows."""
    parameters: list[str] = []
    names: list[str] = []
    lines: list[str] = []
    coordinate = 0
    for number, (row, joint) in enumerate(zip(table.rows, joints, strict=True)):
        factors: list[str] = []
        for motion, parameter in _BEFORE[table.convention] + (_COORDINATE,) + _AFTER[table.convention]:
            if (motion, parameter) == _COORDINATE:
                if joint.active:
                    motion_of_joint = "Rz" if joint.is_angle else "Tz"
                    factors.append(_factor(motion_of_joint, f"q[{coordinate}]"))
                    coordinate += 1
                continue
            quantity = row.values.get(parameter)
            if quantity is not None and quantity.stated_value:
                name = f"{parameter}_{number + 1}"
                names.append(name)
                parameters.append(f'    "{name}": {_parameter_code(quantity, path, row.line)},')
                factors.append(_factor(motion, name))
        if factors:
            lines.append(f"    T = T @ {' @ '.join(factors)}  # {joint.name}")
    coordinates: list[str] = []
    for joint in joints:
        if joint.active:
            coordinate_unit = "rad" if joint.is_angle else "m"
            coordinates.append(f"{joint.name} ({coordinate_unit})")
    signature = f"def forward({', '.join(('q', *names))}):"
    if len(signature) > _LINE_LENGTH:
        argument_lines = ",\n    ".join(("q", *names))
        signature = f"def forward(\n    {argument_lines},\n):"
    parameter_lines = "\n".join(parameters)
    product_lines = "\n".join(lines)
    return f'''"""Equations of {_in_quotes(path.stem)}: the product of the rows of {_in_quotes(path.name)}.

The convention of the table is {_TITLES[table.convention]}. Joints, in the order of q: {", ".join(coordinates)}.
"""

import numpy as np

from twin.formula import {_imported(table)}

PARAMETERS = {{
{parameter_lines}
}}


def turn(axis, angle):
    R = {{"x": rotation_x, "y": rotation_y, "z": rotation_z}}[axis](angle)
    return pose(R, np.zeros(3))


def move(axis, length):
    p = length * np.eye(3)["xyz".index(axis)]
    return pose(np.eye(3), p)


{signature}
    T = np.eye(4)
{product_lines}
    return T
'''


def _imported(table: DhTable) -> str:
    functions = {"pose", "rotation_x", "rotation_y", "rotation_z"}
    for row in table.rows:
        for quantity in row.values.values():
            if quantity.stated_value:
                functions.add(_function(quantity.unit))
    return ", ".join(sorted(functions))


def _function(unit: str) -> str:
    """Return the name of the function of `twin.formula` for numbers in a unit; it has none for cm."""
    return "mm" if unit == "cm" else unit


def _in_quotes(text: str) -> str:
    """Return a text of another person as a part of a string in Python code, without quotes and backslashes."""
    # A file name with quotes could end the string of the written formula.py, and the rest of it would run as code.
    return re.sub(r'["\\]', "_", one_line(text))


def _parameter_code(quantity: CellQuantity, path: Path, line: int) -> str:
    """Return a parameter as code, with the line of the table as its source."""
    value = quantity.stated_value
    if quantity.unit == "cm":  # written in mm, see `_function`
        value *= 10
    source = _in_quotes(path.name)
    return f'{_function(quantity.unit)}({value!r}, "CITED", "{source}, line {line}")'


def _factor(motion: str, name: str) -> str:
    verb = "turn" if motion[0] == "R" else "move"
    return f'{verb}("{motion[1]}", {name})'
