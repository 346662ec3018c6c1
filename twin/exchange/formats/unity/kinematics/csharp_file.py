"""Write the C# file of one robot: its tables, its template, and methods from CasADi graphs."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from twin.codegen import Stage
from twin.codegen.csharp import HELPERS, Place, method, number
from twin.core.spatial import Array
from twin.exchange.formats.unity.kinematics.csharp_values import DeviceModel
from twin.exchange.write.model_hash import model_hash
from twin.kinematics.closed_loops.adjustable import DISTANCES, AdjustableLoops
from twin.kinematics.closed_loops.solver import LoopSolver
from twin.kinematics.compile import Kinematics
from twin.model.joint_distance import kinematic_distances
from twin.model.mechanism import Mechanism

_TEMPLATE = Path(__file__).resolve().parent / "robot.cs.template"
_INDENT = " " * 8
_ON_A_LINE = 6
"""Numbers on a line of a table."""

_POSE_NUMBERS = 12
"""Numbers of a pose in C#: the first three rows of its matrix."""


def class_name(robot: str) -> str:
    """Return the name of the class of a robot: "davinci_psm" becomes "DavinciPsmKinematics"."""
    name = ""
    for word in robot.split("_"):
        name += word[:1].upper() + word[1:]  # not `capitalize`, which would change the other letters
    return f"{name}Kinematics"


def source(model: DeviceModel) -> str:
    """Return the text of the C# file of a robot; the same robot gives the same text.

    Raises:
        AssemblyError: the loops do not close in the rest poses.
        ValueError: the equations contain an operation that C# does not have.
    """
    mechanism = model.mechanism
    solver = LoopSolver(mechanism)
    loops = AdjustableLoops(solver, kinematic_distances(mechanism))
    places = _Places(loops)
    methods = [*HELPERS.splitlines(), ""]
    newton_lines: list[str] = []
    for block, stage in enumerate(loops.newton):
        methods += _member(f"WriteBlock{block}", stage, places)
        newton_lines += [
            f"for (int k = 0; k < {stage.repeat}; k++)",
            "{",
            f"    WriteBlock{block}();",
            f"    if (!(error[0] > {number(stage.tolerance)}))",
            "    {",
            "        break;",
            "    }",
            "}",
            "",
        ]
    methods += _member("WriteEnd", loops.end, places)
    methods += _member("WriteLinks", loops.links, places)
    methods += _member("WriteSlacks", loops.slacks, places)
    equations, equation_methods = _equation_values(model.equations, mechanism.active)
    methods += equation_methods

    text = _TEMPLATE.read_text(encoding="utf-8")
    values = _mechanism_values(model, loops) | _joint_values(mechanism) | equations
    # A robot without loops has no such fields: the compiler of C# would warn of private fields that nothing uses.
    values["NEWTON_FIELDS"] = ""
    if newton_lines:
        values["NEWTON_FIELDS"] = (
            f"{_INDENT}private readonly double[] error = new double[1];\n"
            f"{_INDENT}private readonly double[] determinants = new double[{len(solver.signs)}];\n"
        )
    values["NEWTON"] = "\n".join(f"            {line}".rstrip() for line in newton_lines)
    values["METHODS"] = "\n".join(f"{_INDENT}{line}".rstrip() for line in methods).rstrip()
    for key, value in values.items():
        text = text.replace(f"@{key}@", value)
    # Last, because the hashes are those of the text with all other values.
    return text.replace("@PARTS@", _hashes(text))


_METHOD = re.compile(r" {8}(public|private)\b[^=]*?(\w+)\([^()]*\)")
"""Line at which a method begins."""


_TABLE = re.compile(r" {8}private (?:const|static readonly) \S+ (\w+) =")
"""Begin of a constant or table; it ends before the next private member or empty line."""


def _hashes(text: str) -> str:
    """Return comments with the hash of each method, of all that stands before the first one, and of each table there.

    The code begins behind the first "using System;". A hash is the first 16 digits of the SHA-256 of lines; a second
    method of one name has a number behind its name.
    """
    titles = ["tables"]
    bodies: list[list[str]] = [[]]
    for line in text.split("using System;", 1)[1].split("\n"):
        match = _METHOD.fullmatch(line)
        if match:
            title = match[2]
            titles.append(title if title not in titles else f"{title} {len(titles)}")
            bodies.append([])
        bodies[-1].append(line)
    lines = []
    for title, body in zip(titles, bodies, strict=True):
        digest = hashlib.sha256("\n".join(body).encode()).hexdigest()
        lines.append(f"//   {digest[:16]} {title}")
    for title, body in _tables(bodies[0]).items():
        digest = hashlib.sha256("\n".join(body).encode()).hexdigest()
        lines.append(f"//   {digest[:16]} table {title}")
    return "\n".join(lines)


def _tables(lines: list[str]) -> dict[str, list[str]]:
    """Return {name: lines} of the constants and tables in lines."""
    tables: dict[str, list[str]] = {}
    current: list[str] = []
    for line in lines:
        match = _TABLE.match(line)
        if match:
            current = tables.setdefault(match[1], [])
        elif not line or line.startswith(f"{_INDENT}private "):
            current = []
        current.append(line)
    return tables


class _Places:
    """The C# array entries of the named arguments and results of stages."""

    def __init__(self, loops: AdjustableLoops) -> None:
        equations = loops.equations
        self._places: dict[str, list[Place]] = {
            "q": _entries("q", equations.q.numel()),
            DISTANCES: _entries("distances", len(loops.distances)),
            "error": _entries("error", 1),
            "pose": _entries("tool", _POSE_NUMBERS),
            "gaps": _entries("gaps", 3),
            "states": _entries("states", equations.states.numel()),
            "links": _entries("poses", _POSE_NUMBERS * len(equations.mechanism.bodies)),
            "slacks": _entries("slacks", len(loops.limits)),
        }
        start = 0
        for passive in equations.passive:
            count = passive.state.numel()
            self._places[passive.key] = _entries("states", count, start)
            start += count
        for index, name in enumerate(loops.solver.signs):
            self._places[name] = _entries("determinants", 1, index)

    def of(self, names: Iterable[str]) -> list[Place]:
        """Return the places of several arguments or results, one after the other."""
        places: list[Place] = []
        for name in names:
            places += self._places[name]
        return places


def _entries(array: str, count: int, start: int = 0) -> list[Place]:
    return [(array, index) for index in range(start, start + count)]


def _member(name: str, stage: Stage, places: _Places) -> list[str]:
    return [*method(name, stage.function, places.of(stage.takes), places.of(stage.gives)), ""]


def _mechanism_values(model: DeviceModel, loops: AdjustableLoops) -> dict[str, str]:
    """Return the values of the template that come from the mechanism."""
    mechanism = model.mechanism
    solver = loops.solver
    bounds = model.bounds
    tool = mechanism.frame(mechanism.tool)
    home = mechanism.home
    if home is None:
        home = solver.q
    distance_names: list[str] = []
    distances: list[float] = []
    for distance in loops.distances:
        distance_names.append(f"{distance.body}: {distance.joint} to {distance.other}")
        distances.append(distance.distance)
    kind_words = {"lower": "minimum", "upper": "maximum", "gap": "distance on the rail", "motor": "motor"}
    bound_names: list[str] = []
    bound_kinds: list[str] = []
    bound_weights: list[Array] = []
    bound_least: list[float] = []
    for bound in bounds:
        bound_names.append(bound.name)
        bound_kinds.append(kind_words[bound.kind])
        bound_weights.append(bound.weights)
        bound_least.append(bound.least)
    active_names: list[str] = []
    angles: list[str] = []
    for joint in mechanism.active:
        active_names.append(joint.name)
        angles.append(_csharp_bool(joint.is_angle))
    return {
        "ROBOT": mechanism.name,
        "NAME": _csharp_string(mechanism.name),
        "CLASS": class_name(mechanism.name),
        "HASH": model_hash(mechanism),
        "GAP": number(solver.gap),
        "TILT": number(solver.tilt),
        "JOINTS": _csharp_strings(active_names),
        "ANGLES": _csharp_list(angles),
        "LINKS": _csharp_strings([body.name for body in mechanism.bodies]),
        "LINK_COUNT": str(len(mechanism.bodies)),
        "TOOL_LINK": _csharp_string(tool.body),
        "TOOL_FRAME": _csharp_numbers(np.asarray(tool.T_body_frame)[:3].ravel()),
        "BOUND_NAMES": _csharp_strings(bound_names),
        "BOUND_KINDS": _csharp_strings(bound_kinds),
        "BOUND_WEIGHTS": _csharp_numbers(np.array(bound_weights).ravel()),
        "BOUND_LEAST": _csharp_numbers(np.array(bound_least)),
        "PASSIVE_NAMES": _csharp_strings([limit.joint.name for limit in loops.limits]),
        "PASSIVE_COUNT": str(len(loops.limits)),
        "DISTANCE_NAMES": _csharp_strings(distance_names),
        "DISTANCES": _csharp_numbers(np.array(distances)),
        "REST_JOINTS": _csharp_numbers(solver.q),
        "REST_STATES": _csharp_numbers(np.concatenate([*solver.home, []])),  # [] for robots without loops
        "HOME": _csharp_numbers(np.asarray(home)),
    }


def _joint_values(mechanism: Mechanism) -> dict[str, str]:
    """Return the values of the template that describe all joints, in the tree and in loops, and the masses of links."""
    body_names = [body.name for body in mechanism.bodies]
    active_names = [joint.name for joint in mechanism.active]
    loop_names = {joint.name for joint in mechanism.loops}
    names: list[str] = []
    types: list[str] = []
    in_loops: list[str] = []
    parents: list[str] = []
    children: list[str] = []
    active: list[str] = []
    frames: list[Array] = []
    limits: list[float] = []
    for joint in mechanism.joints:
        names.append(joint.name)
        types.append(joint.type)
        in_loops.append(_csharp_bool(joint.name in loop_names))
        parents.append(str(body_names.index(joint.parent)))
        children.append(str(body_names.index(joint.child)))
        number_of_active = -1  # a passive joint
        if joint.name in active_names:
            number_of_active = active_names.index(joint.name)
        active.append(str(number_of_active))
        for T in (joint.T_parent_joint, joint.T_child_joint):
            frames.append(np.asarray(T, float)[:3].ravel())
        limits += joint.limits or (-np.inf, np.inf)
    masses = []
    for body in mechanism.bodies:
        mass = 0.0  # unknown
        if body.inertia is not None:
            mass = body.inertia.mass
        masses.append(mass)
    return {
        "ALL_JOINTS": _csharp_strings(names),
        "JOINT_TYPES": _csharp_strings(types),
        "IN_LOOPS": _csharp_list(in_loops),
        "JOINT_PARENTS": _csharp_list(parents),
        "JOINT_CHILDREN": _csharp_list(children),
        "JOINT_ACTIVE": _csharp_list(active),
        "JOINT_FRAMES": _csharp_numbers(np.concatenate(frames)),
        "JOINT_LIMITS": _csharp_numbers(np.array(limits, float)),
        "LINK_MASSES": _csharp_numbers(np.array(masses, float)),
    }


def _equation_values(kinematics: Kinematics | None, active: Sequence) -> tuple[dict[str, str], list[str]]:
    """Return the values of the template that come from the equations, and their methods."""
    if kinematics is None or not kinematics.closed_inverse:
        empty = dict.fromkeys(("PARAMETER_NAMES", "PARAMETERS", "MEASURE_NAMES", "MEASURE_ALARMS"), "")
        none = ["private void WriteInverse() { }", "private void WriteMargins() { }"]
        return empty | {"HAS_EQUATIONS": "false", "MARGINS": "0"}, none
    program = kinematics.program
    joint_count = len(active)
    parameters = _entries("parameters", len(kinematics.parameters))
    pose = _entries("target", 16)
    inverse = program.inverse_of_parameters.function
    methods = [*method("WriteInverse", inverse, [*parameters, *pose], _entries("found", joint_count + 1)), ""]

    margins = program.margins_at((), ()).function
    scalars = kinematics.formula.scalars
    reach_count = len(scalars["reach"])
    measures = kinematics.formula.measures
    measure_names: list[str] = []
    alarms: list[float] = []
    for measure in measures:
        measure_names.append(measure.name)
        alarms.append(measure.alarm)
    # The margins are: reach, measures, aspects; the file has the measures first.
    places = _entries("margins", reach_count, len(measures))
    places += _entries("margins", len(measures))
    places += _entries("margins", len(scalars["aspect"]), len(measures) + reach_count)
    methods += method("WriteMargins", margins, [*parameters, *pose, *_entries("q", joint_count)], places)
    return {
        "HAS_EQUATIONS": "true",
        "PARAMETER_NAMES": _csharp_strings(list(kinematics.parameters)),
        "PARAMETERS": _csharp_numbers(np.array(list(kinematics.parameters.values()), float)),
        "MEASURE_NAMES": _csharp_strings(measure_names),
        "MEASURE_ALARMS": _csharp_numbers(np.array(alarms, float)),
        "MARGINS": str(len(places)),
    }, methods


def _csharp_string(text: str) -> str:
    return json.dumps(text)


def _csharp_bool(value: bool) -> str:
    return "true" if value else "false"


def _csharp_strings(texts: Sequence[str]) -> str:
    return _csharp_list(list(map(_csharp_string, texts)))


def _csharp_numbers(values: Array) -> str:
    return _csharp_list([number(float(value)) for value in values])


def _csharp_list(entries: Sequence[str]) -> str:
    """Return the entries of a C# array, a few on each line."""
    if len(entries) <= _ON_A_LINE:
        return ", ".join(entries)
    lines = []
    for start in range(0, len(entries), _ON_A_LINE):
        lines.append(f"{_INDENT}    " + ", ".join(entries[start : start + _ON_A_LINE]))
    return "\n" + ",\n".join(lines) + f"\n{_INDENT}"
