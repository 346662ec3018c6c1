"""Robots of tests/kinerrata as xacro: a file with a macro for the chain, and a file that calls it."""

from __future__ import annotations

import copy
import tomllib
from pathlib import Path

ENTRIES = Path(__file__).parents[1] / "kinerrata"
COMPONENTS = {"x": 0, "y": 1, "z": 2}
HEAD = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"'


def written(name: str, folder: Path, corrected: bool) -> Path:
    """Write the robot of an entry, with its wrong or its corrected numbers; return the file to read."""
    entry = tomllib.loads((ENTRIES / f"{name}.toml").read_text(encoding="utf-8"))
    joints = {joint["name"]: copy.deepcopy(joint) for joint in entry["joint"]}
    if not corrected:
        for number in entry["number"]:
            joint, kind, component = number["place"].split()
            key = {"origin": "xyz", "axis": "axis"}[kind]
            joints[joint][key][COMPONENTS[component]] = number["before"]
    links = []
    for joint in joints.values():
        for link in (joint["parent"], joint["child"]):
            if link not in links:
                links.append(link)
    lines = [f"{HEAD}>", '<xacro:macro name="arm" params="">']
    lines += [f'  <link name="{link}"/>' for link in links]
    for joint in joints.values():
        lines += _joint(joint)
    lines += ["</xacro:macro>", "</robot>"]
    folder.mkdir(parents=True)
    macro = folder / f"{name}_macro.xacro"
    macro.write_text("\n".join(lines) + "\n", encoding="utf-8")
    robot = folder / f"{name}.urdf.xacro"
    call = f'{HEAD} name="{name}">\n<xacro:include filename="{macro.name}"/>\n<xacro:arm/>\n</robot>\n'
    robot.write_text(call, encoding="utf-8")
    return robot


def _joint(joint: dict) -> list[str]:
    origin = f'<origin xyz="{_numbers(joint["xyz"])}" rpy="{_numbers(joint["rpy"])}"/>'
    lines = [
        f'  <joint name="{joint["name"]}" type="{joint["type"]}">',
        f"    {origin}",
        f'    <parent link="{joint["parent"]}"/>',
        f'    <child link="{joint["child"]}"/>',
    ]
    if joint["type"] != "fixed":
        lines.append(f'    <axis xyz="{_numbers(joint["axis"])}"/>')
        lines.append(f'    <limit lower="{joint["lower"]}" upper="{joint["upper"]}" effort="100" velocity="2"/>')
    return [*lines, "  </joint>"]


def _numbers(values: list[float]) -> str:
    return " ".join(str(value) for value in values)
