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
from twin.exchange.write.clip import model_hash
from twin.kinematics.closed_loops.adjustable import DISTANCES, AdjustableLoops
from twin.kinematics.closed_loops.solver import LoopSolver
from twin.kinematics.compile import Kinematics
from twin.model.joint_distance import kinematic_distances
from twin.model.mechanism import Mechanism

_TEMPLATE = Path(__file__).resolve().parent / "robot.cs.template"
_INDENT = " " * 8
_ON_A_LINE = 6
"""Numbers on a line of a table."""


def class_name(robot: str) -> str:
    """Return the name of the class of a robot: "davinci_psm" becomes "DavinciPsmKinematics"."""
    words = [word[:1].upper() + word[1:] for word in robot.split("_")]
    return "".join(words) + "Kinematics"


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
    newton: list[str] = []
    for k, stage in enumerate(loops.newton):
        methods += _member(f"WriteBlock{k}", stage, places)
        newton += [
            f"for (int k = 0; k < {stage.repeat}; k++)",
            "{",
            f"    WriteBlock{k}();",
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
    equations, equation_methods = _equations(model.equations, mechanism.active)
    methods += equation_methods

    text = _TEMPLATE.read_text(encoding="utf-8")
    values = _mechanism_tables(model, loops) | _joint_tables(mechanism) | equations
    values["NEWTON_FIELDS"] = ""
    if newton:
        values["NEWTON_FIELDS"] = (
            f"{_INDENT}private readonly double[] error = new double[1];\n"
            f"{_INDENT}private readonly double[] determinants = new double[{len(solver.signs)}];\n"
        )
    values["NEWTON"] = "\n".join(f"            {line}".rstrip() for line in newton)
    values["METHODS"] = "\n".join(f"{_INDENT}{line}".rstrip() for line in methods).rstrip()
    for key, value in values.items():
        text = text.replace(f"@{key}@", value)
    return text.replace("@PARTS@", _hashes(text))


_MEMBER = re.compile(r" {8}(public|private)\b[^=]*?(\w+)\([^()]*\)")
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
        found = _MEMBER.fullmatch(line)
        if found:
            title = found[2]
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
        found = _TABLE.match(line)
        if found:
            current = tables.setdefault(found[1], [])
        elif not line or line.startswith(f"{_INDENT}private "):
            current = []
        current.append(line)
    return tables


class _Places:
    """The C# array entries of the named arguments and results of stages."""

    def __init__(self, loops: AdjustableLoops) -> None:
        e = loops.equations
        self._known: dict[str, list[Place]] = {
            "q": _entries("q", e.q.numel()),
            DISTANCES: _entries("distances", len(loops.distances)),
            "error": _entries("error", 1),
            "pose": _entries("tool", 12),
            "gaps": _entries("gaps", 3),
            "states": _entries("states", e.states.numel()),
            "links": _entries("poses", 12 * len(e.mechanism.bodies)),
            "slacks": _entries("slacks", len(loops.limits)),
        }
        start = 0
        for passive in e.passive:
            count = passive.state.numel()
            self._known[passive.key] = _entries("states", count, start)
            start += count
        for i, name in enumerate(loops.solver.signs):
            self._known[name] = _entries("determinants", 1, i)

    def of(self, names: Iterable[str]) -> list[Place]:
        """Return the places of several arguments or results, one after the other."""
        places: list[Place] = []
        for name in names:
            places += self._known[name]
        return places


def _entries(array: str, count: int, start: int = 0) -> list[Place]:
    return [(array, i) for i in range(start, start + count)]


def _member(name: str, stage: Stage, places: _Places) -> list[str]:
    return [*method(name, stage.function, places.of(stage.takes), places.of(stage.gives)), ""]


def _mechanism_tables(model: DeviceModel, loops: AdjustableLoops) -> dict[str, str]:
    """Return the values of the template that come from the mechanism."""
    mechanism = model.mechanism
    solver = loops.solver
    bounds = model.bounds
    tool = mechanism.frame(mechanism.tool)
    home = mechanism.home
    if home is None:
        home = solver.q
    distance_names = [f"{d.body}: {d.joint} to {d.other}" for d in loops.distances]
    bound_kinds = {"lower": "minimum", "upper": "maximum", "gap": "distance on the rail", "motor": "motor"}
    return {
        "ROBOT": mechanism.name,
        "NAME": _string(mechanism.name),
        "CLASS": class_name(mechanism.name),
        "HASH": model_hash(mechanism),
        "GAP": number(solver.gap),
        "TILT": number(solver.tilt),
        "JOINTS": _strings([joint.name for joint in mechanism.active]),
        "ANGLES": _list([str(joint.is_angle).lower() for joint in mechanism.active]),
        "LINKS": _strings([body.name for body in mechanism.bodies]),
        "LINK_COUNT": str(len(mechanism.bodies)),
        "TOOL_LINK": _string(tool.body),
        "TOOL_FRAME": _numbers(np.asarray(tool.T_body_frame)[:3].ravel()),
        "BOUND_NAMES": _strings([bound.name for bound in bounds]),
        "BOUND_KINDS": _strings([bound_kinds[bound.kind] for bound in bounds]),
        "BOUND_WEIGHTS": _numbers(np.array([bound.weights for bound in bounds]).ravel()),
        "BOUND_LEAST": _numbers(np.array([bound.least for bound in bounds])),
        "PASSIVE_NAMES": _strings([limit.joint.name for limit in loops.limits]),
        "PASSIVE_COUNT": str(len(loops.limits)),
        "DISTANCE_NAMES": _strings(distance_names),
        "DISTANCES": _numbers(np.array([d.distance for d in loops.distances])),
        "REST_JOINTS": _numbers(solver.q),
        "REST_STATES": _numbers(np.concatenate([*solver.home, []])),
        "HOME": _numbers(np.asarray(home)),
    }


def _joint_tables(mechanism: Mechanism) -> dict[str, str]:
    """Return the values of the template that describe all joints, in the tree and in loops, and the masses of links."""
    order = {body.name: i for i, body in enumerate(mechanism.bodies)}
    active = {joint.name: i for i, joint in enumerate(mechanism.active)}
    loops = {joint.name for joint in mechanism.loops}
    frames = []
    limits = []
    for joint in mechanism.joints:
        for T in (joint.T_parent_joint, joint.T_child_joint):
            frames.append(np.asarray(T, float)[:3].ravel())
        limits += joint.limits or (-np.inf, np.inf)
    masses = []
    for body in mechanism.bodies:
        mass = 0.0  # unknown
        if body.inertia is not None:
            mass = body.inertia.mass
        masses.append(mass)
    joints = mechanism.joints
    return {
        "ALL_JOINTS": _strings([joint.name for joint in joints]),
        "JOINT_TYPES": _strings([joint.type for joint in joints]),
        "IN_LOOPS": _list([str(joint.name in loops).lower() for joint in joints]),
        "JOINT_PARENTS": _list([str(order[joint.parent]) for joint in joints]),
        "JOINT_CHILDREN": _list([str(order[joint.child]) for joint in joints]),
        "JOINT_ACTIVE": _list([str(active.get(joint.name, -1)) for joint in joints]),
        "JOINT_FRAMES": _numbers(np.concatenate(frames)),
        "JOINT_LIMITS": _numbers(np.array(limits, float)),
        "LINK_MASSES": _numbers(np.array(masses, float)),
    }


def _equations(kinematics: Kinematics | None, active: Sequence) -> tuple[dict[str, str], list[str]]:
    """Return the values of the template that come from the equations, and their methods."""
    if kinematics is None or not kinematics.closed_inverse:
        empty = dict.fromkeys(("PARAMETER_NAMES", "PARAMETERS", "MEASURE_NAMES", "MEASURE_ALARMS"), "")
        none = ["private void WriteInverse() { }", "private void WriteMargins() { }"]
        return empty | {"HAS_EQUATIONS": "false", "MARGINS": "0"}, none
    program = kinematics.program
    n = len(active)
    parameters = _entries("parameters", len(kinematics.parameters))
    pose = _entries("target", 16)
    inverse = program.inverse_of_parameters.function
    methods = [*method("WriteInverse", inverse, [*parameters, *pose], _entries("found", n + 1)), ""]

    margins = program.margins_at((), ()).function
    scalars = kinematics.formula.scalars
    reach_count = len(scalars["reach"])
    measures = kinematics.formula.measures
    # The margins are: reach, measures, aspects; the file has the measures first.
    places = _entries("margins", reach_count, len(measures))
    places += _entries("margins", len(measures))
    places += _entries("margins", len(scalars["aspect"]), len(measures) + reach_count)
    methods += method("WriteMargins", margins, [*parameters, *pose, *_entries("q", n)], places)
    return {
        "HAS_EQUATIONS": "true",
        "PARAMETER_NAMES": _strings(list(kinematics.parameters)),
        "PARAMETERS": _numbers(np.array(list(kinematics.parameters.values()), float)),
        "MEASURE_NAMES": _strings([measure.name for measure in measures]),
        "MEASURE_ALARMS": _numbers(np.array([measure.alarm for measure in measures], float)),
        "MARGINS": str(len(places)),
    }, methods


def _string(text: str) -> str:
    return json.dumps(text)


def _strings(texts: Sequence[str]) -> str:
    return _list([_string(text) for text in texts])


def _numbers(values: Array) -> str:
    return _list([number(float(value)) for value in values])


def _list(entries: Sequence[str]) -> str:
    """Return the entries of a C# array, a few on each line."""
    if len(entries) <= _ON_A_LINE:
        return ", ".join(entries)
    lines = []
    for start in range(0, len(entries), _ON_A_LINE):
        lines.append(f"{_INDENT}    " + ", ".join(entries[start : start + _ON_A_LINE]))
    return "\n" + ",\n".join(lines) + f"\n{_INDENT}"
