"""Facts about a robot or a scene, and the list of built-in robots and scenes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from twin.api.robot import Robot
from twin.core import assets
from twin.core.findings import Finding, by_severity
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.progress import Progress, silent
from twin.core.result import Part, Result, TextTable
from twin.core.units import MM, display_unit

if TYPE_CHECKING:
    from twin.core.provenance import Parameter
    from twin.model.joint import Joint
    from twin.model.mechanism import Mechanism
    from twin.model.scene import Scene
    from twin.model.transmission import Transmission

BRIEF_LINES = 30
"""Largest number of lines of the brief form of `twin info`."""

_BRIEF_JOINTS = 10
"""Largest number of driven joints in the brief form."""

_BRIEF_FINDINGS = 2
"""Largest number of findings in the brief form; each can take two lines."""

_BRIEF_NAMES = 8
"""Largest number of names in one line of the brief form."""

SCENE_COMMANDS = ("info", "run", "view", "serve", "export")
"""Commands that accept a scene in which every robot has a protocol."""


def scene_commands(scene: Scene) -> tuple[str, ...]:
    """Return the twin commands that accept a scene.

    "run" and "export" require a protocol for every robot. "run" also requires that no robot plays a protocol file of
    the scene, because USD stages contain only the motions of the robots' own protocols. "operate" requires tasks or
    machines.
    """
    commands: list[str] = ["info", "view", "serve"]
    if scene.has_protocols:
        commands = list(SCENE_COMMANDS)
        plays_files = any(place.protocol.endswith(".toml") for place in scene.places)
        if plays_files:
            commands.remove("run")
    if scene.tasks or scene.trainer is not None:
        commands.append("operate")
    return tuple(commands)


@dataclass(frozen=True)
class Info(Result):
    """Joints, limits, frames, degrees of freedom, variants and parameters of a robot.

    Attributes:
        data: the facts about the robot as plain data (numbers, texts, lists, dicts), in SI units.
        bodies: number of bodies.
        findings: findings on the CAD, and a warning if the mechanism is singular in the CAD's rest poses.
    """

    kind: ClassVar[str] = "info"
    data: JsonMapping
    bodies: int
    findings: tuple[Finding, ...]

    def content(self) -> JsonMapping:
        """Return the facts about the robot as plain data."""
        return self.data

    def text(self) -> Iterator[Part]:
        """Yield the mechanism, the variants of the equations, the parameters with provenance, and the findings."""
        data = self.data
        yield self._title
        yield f"  {data['source']}\n"
        loops = "no loops"
        closing = []
        for joint in data["joints"]:
            if joint["closes_loop"]:
                closing.append(joint["name"])
        if closing:
            loops = f"loops closed by {', '.join(closing)}"
        yield (
            f"  {self.bodies} bodies, {len(data['joints'])} joints, {data['degrees_of_freedom']} degrees of freedom, "
            f"{data['redundant_constraints']} redundant constraints; {loops}"
        )
        for name, redundant in data["redundant"].items():
            constraints = ", ".join(redundant["among"])
            yield f"    loop {name}: {redundant['count']} of its constraints {constraints} are redundant"
        frames = ", ".join(data["frames"])
        points = ", ".join(data["points"]) or "none"
        yield f"  frames: {frames}   points: {points}\n"
        rows = [_joint_row(joint) for joint in data["joints"]]
        yield TextTable(_JOINT_COLUMNS, rows)
        yield ""
        yield from _motors(data["actuators"], data["transmissions"])
        if data["variants"]:
            yield "  equations and their variants (* in use)"
        else:
            yield "  no equations"
        for name, choices in data["variants"].items():
            for variant, reason in choices.items():
                mark = "*" if data["chosen"][name] == variant else " "
                line = f"  {mark}{name}={variant}"
                if reason:
                    line += f": {reason}"
                yield line
        if data["parameters"]:
            yield "\n  parameters (* assumed: not published)"
            yield _parameters(sorted(data["parameters"], key=_parameter_order))
        yield from self.findings

    def brief(self, word: str) -> Iterator[Part]:
        """Yield at most `BRIEF_LINES` lines: driven joints, names, counts of the rest, and the most severe findings.

        `word` is the name or path of the robot in the command that shows all.
        """
        data = self.data
        yield self._title
        yield f"  {data['source']}"
        joints = data["joints"]
        loops = 0
        driven = []
        for joint in joints:
            loops += joint["closes_loop"]
            if joint["active"] or joint["auxiliary"]:
                driven.append(_joint_row(joint))
        yield (
            f"  {self.bodies} bodies, {len(joints)} joints, {data['degrees_of_freedom']} degrees of freedom, "
            f"{data['redundant_constraints']} redundant constraints; {loops} loops\n"
        )
        yield TextTable(_JOINT_COLUMNS, driven[:_BRIEF_JOINTS])
        if len(driven) > _BRIEF_JOINTS:
            yield f"  and {len(driven) - _BRIEF_JOINTS} more driven joints"
        yield ""
        passive = len(joints) - len(driven)
        yield f"  passive joints  {passive}"
        if data["transmissions"]:  # without them, each motor is its joint, which is in the table
            motors = [actuator["name"] for actuator in data["actuators"]]
            yield f"  motors          {_few(motors)}"
        yield f"  frames          {_few(data['frames'])}"
        yield f"  points          {_few(data['points'])}"
        yield f"  postures        {_few(data['postures'])}"
        variants = []
        for name, choices in data["variants"].items():
            for variant in choices:
                mark = "*" if data["chosen"][name] == variant else ""
                variants.append(f"{name}={variant}{mark}")
        equations = "no equations"
        if variants:
            equations = f"{_few(variants)} (* in use)"
        yield f"  equations       {equations}"
        counts: Counter[str] = Counter()
        for parameter in data["parameters"]:
            counts[parameter["provenance"]] += 1
        texts = []
        for provenance, count in sorted(counts.items()):
            texts.append(f"{count} {provenance}")
        yield f"  parameters      {', '.join(texts) or 'none'}"
        severe = []
        for finding in by_severity(self.findings):
            if finding.severity != "info":
                severe.append(finding)
        yield from severe[:_BRIEF_FINDINGS]
        if len(severe) > _BRIEF_FINDINGS:
            yield f"  and {len(severe) - _BRIEF_FINDINGS} more findings"
        yield f"  All joints, motors and parameters: twin info {word} --all"

    @property
    def _title(self) -> str:
        """Name of the robot, with the title in its description if there is one."""
        if self.data["title"]:
            return f"{self.data['name']}: {self.data['title']}"
        return self.data["name"]


@dataclass(frozen=True)
class SceneInfo(Result):
    """Robots and props of a scene, and its parameters with provenance.

    Attributes:
        data: the facts about the scene as plain data (numbers, texts, lists, dicts).
    """

    kind: ClassVar[str] = "info"
    data: JsonMapping
    findings: tuple[Finding, ...] = ()

    def content(self) -> JsonMapping:
        """Return the facts about the scene as plain data."""
        return self.data

    def text(self) -> Iterator[Part]:
        """Yield the robots, the surroundings, the cameras and the parameters."""
        data = self.data
        yield f"{data['name']}: {data['title']}\n  {data['source']}\n"
        rows = []
        for robot in data["robots"]:
            port_position = _point(robot["port_mm"])
            base_position = _point(robot["position_mm"])
            rows.append((_label(robot), robot["protocol"], robot["port"], port_position, base_position))
        yield TextTable(("robot", "protocol", "port", "port position [mm]", "base position [mm]"), rows)
        surroundings = data["surroundings"] or "none"
        yield f"\n  surroundings: {surroundings}; required clearance: {data['clearance_mm']:g} mm"
        cameras = []
        for name, camera in data["cameras"].items():
            cameras.append(f"  camera {name}: {camera['robot']}, frame {camera['frame']}")
        yield "\n".join(cameras)
        yield "\n  parameters (* assumed: not published)"
        yield _parameters(data["parameters"])
        yield f"\n  commands: {', '.join(data['commands'])}"


@dataclass(frozen=True)
class Listing(Result):
    """The built-in robots and scenes.

    Attributes:
        robots: for each robot, its name, kind and title, whether it has equations and a stage, and its protocols.
        scenes: for each scene, its name, kind, title and robots.
    """

    kind: ClassVar[str] = "list"
    robots: Sequence[JsonMapping]
    scenes: Sequence[JsonMapping]
    findings: tuple[Finding, ...] = ()

    def content(self) -> JsonMapping:
        """Return the list of the robots and the list of the scenes as plain data."""
        return {"robots": self.robots, "scenes": self.scenes}

    def text(self) -> Iterator[Part]:
        """Yield a table of the robots and a table of the scenes."""
        word = {True: "yes", False: "-"}
        robots = []
        for robot in self.robots:
            protocols = ", ".join(robot["protocols"])
            robots.append((robot["name"], robot["title"], word[robot["equations"]], word[robot["stage"]], protocols))
        yield TextTable(("robot", "title", "equations", "stage", "protocols"), robots)
        yield ""
        scenes = []
        for scene in self.scenes:
            scenes.append((scene["name"], scene["title"], ", ".join(scene["robots"])))
        yield TextTable(("scene", "title", "robots"), scenes)


def info(robot: Robot, progress: Progress = silent) -> Info:
    """Return the joints, limits, frames, variants and parameters of a robot.

    Raises:
        TwinError: the robot's description, CAD, stage or equations are malformed.
    """
    from twin.reference.regularity import singular_home

    progress("read CAD", 0.0)
    mechanism = robot.mechanism
    model = robot.reference()
    home = model.home().x
    mobility = model.mobility(home)
    title = ""
    source = mechanism.source
    parameters: list[Parameter] = list(mechanism.parameters)
    findings = singular_home(model, home)
    variants: dict[str, dict[str, str]] = {}
    chosen: dict[str, str] = {}
    if robot.files is not None:  # a stage or a description file has neither drawing dimensions nor equations
        cad = robot.cad
        title = cad.description.title
        source = cad.description.source
        parameters += cad.dimensions
        findings = [*cad.findings, *findings]
        if robot.files.has_equations:
            kin = robot.kinematics()
            source = kin.formula.source
            parameters = [*kin.formula.parameters, *parameters]
            chosen = dict(kin.variants)
            for equation in kin.formula.equations:
                if equation.stage == "helper":  # not printed in the source, so it has no printed variant
                    continue
                reasons: dict[str, str] = {}
                for variant in equation.variants:
                    reasons[variant] = equation.reasons.get(variant, "")
                variants[equation.name] = reasons
    redundant = {}
    for loop, count in mobility.redundant.items():
        if count:
            redundant[loop] = {"count": count, "among": mobility.repeated[loop]}
    data = {
        "name": robot.name,
        "title": title,
        "source": source,
        "degrees_of_freedom": mobility.freedom,
        "redundant_constraints": mobility.redundancy,
        "redundant": redundant,
        "joints": [_joint(joint, mechanism) for joint in mechanism.joints],
        "actuators": list(map(vars, mechanism.actuators)),
        "transmissions": list(map(_transmission, mechanism.transmissions)),
        "frames": [frame.name for frame in mechanism.frames],
        "points": [point.name for point in mechanism.points],
        "postures": list(mechanism.postures),
        "variants": variants,
        "chosen": chosen,
        "parameters": list(map(vars, parameters)),
    }
    return Info(data, len(mechanism.bodies), tuple(findings))


def info_of_scene(scene: Scene, word: str) -> SceneInfo:
    """Return the robots, props, parameters and commands of a scene; `word` names the scene in the commands."""
    robots = []
    for place in scene.places:
        # a robot has one row: of several ports, only the first is shown
        p_world_port = next(iter(place.p_world_ports.values()))
        robot = {
            "name": place.name,
            "robot": place.robot,
            "protocol": place.protocol_name,
            "port": place.port,
            "port_mm": (p_world_port / MM).tolist(),
            "position_mm": (place.T_world_base[:3, 3] / MM).tolist(),
        }
        robots.append(robot)
    cameras = {}
    for name, camera in scene.cameras.items():
        cameras[name] = {"robot": camera.robot, "frame": camera.frame}
    commands = [f"twin {command} {word}" for command in scene_commands(scene)]
    surroundings = None
    if scene.props is not None:
        surroundings = scene.props.stem
    data = {
        "name": scene.name,
        "title": scene.title,
        "source": scene.source,
        "robots": robots,
        "cameras": cameras,
        "surroundings": surroundings,
        "clearance_mm": scene.clearance / MM,
        # pairs are sets, whose order differs from run to run
        "touching": sorted(map(sorted, scene.touching)),
        "parameters": list(map(vars, scene.parameters)),
        "commands": commands,
    }
    return SceneInfo(data)


def listing() -> Listing:
    """Return the built-in robots and scenes.

    Raises:
        DescriptionError: a file of a built-in robot or scene is malformed.
    """
    from twin.cad.description import load
    from twin.model.scene import load_scene

    robots = []
    for name in assets.names():
        files = assets.files(name)
        robots.append(
            {
                "name": name,
                "kind": "robot",
                "title": load(files.description, files.read).title,
                "equations": files.has_equations,
                "stage": files.stage.is_file(),
                "protocols": sorted(files.protocols()),
            }
        )
    scenes = []
    for name in assets.scenes():
        scene = load_scene(assets.data_folder() / "cad" / name / "scene.toml")
        placed_robots = [place.robot for place in scene.places]
        scenes.append({"kind": "scene", "name": scene.name, "title": scene.title, "robots": placed_robots})
    return Listing(robots, scenes)


def _joint(joint: Joint, mechanism: Mechanism) -> JsonObject:
    return {
        "name": joint.name,
        "type": joint.type,
        "parent": joint.parent,
        "child": joint.child,
        "active": joint.active,
        "auxiliary": joint in mechanism.auxiliary,
        "limits": joint.limits,
        "closes_loop": joint in mechanism.loops,
    }


def _transmission(transmission: Transmission) -> JsonObject:
    return {
        "name": transmission.name,
        "joints": transmission.joints,
        "actuators": transmission.actuators,
        "matrix": transmission.matrix.tolist(),
        "equations": transmission.equations,
    }


def _few(names: Sequence[str]) -> str:
    """Return the first `_BRIEF_NAMES` names, and how many there are more."""
    text = ", ".join(names[:_BRIEF_NAMES]) or "none"
    if len(names) > _BRIEF_NAMES:
        text += f" and {len(names) - _BRIEF_NAMES} more"
    return text


_JOINT_COLUMNS = ("joint", "type", "between", "limits", "")
"""Header of a table of joints; the last column is what `_joint_row` says of the joint's role."""


def _joint_row(joint: JsonMapping) -> tuple[str, ...]:
    # an auxiliary joint is active as well: the rarer property is shown
    if joint["auxiliary"]:
        role = "auxiliary"
    elif joint["active"]:
        role = "driven"
    elif joint["closes_loop"]:
        role = "closes a loop"
    else:
        role = ""
    limits = _range(joint["limits"], joint["type"] == "revolute")
    return joint["name"], joint["type"], f"{joint['parent']} -> {joint['child']}", limits, role


def _range(limits: Sequence[float] | None, is_angle: bool) -> str:
    """Return limits (low, high) in rad or m as text in degrees or mm; "" without limits."""
    if limits is None:
        return ""
    unit, scale = display_unit(is_angle)
    return f"{limits[0] / scale:g} .. {limits[1] / scale:g} {unit}"


def _motors(actuators: Sequence[JsonMapping], transmissions: Sequence[JsonMapping]) -> Iterator[Part]:
    """Yield a table of the motors and a line for each transmission; without transmissions, yield nothing."""
    if not transmissions:
        return
    rows = []
    for actuator in actuators:
        is_angle = actuator["kind"] == "angle"
        unit, scale = display_unit(is_angle)
        effort_unit = "N m" if is_angle else "N"
        inertia_unit = "kg m2" if is_angle else "kg"
        speed = ""
        if actuator["max_speed"] is not None:
            speed = f"{actuator['max_speed'] / scale:g} {unit}/s"
        effort = ""
        if actuator["max_effort"] is not None:
            effort = f"{actuator['max_effort']:g} {effort_unit}"
        inertia = ""
        if actuator["rotor_inertia"] is not None:
            inertia = f"{actuator['rotor_inertia']:g} {inertia_unit}"
        rows.append((actuator["name"], actuator["kind"], _range(actuator["limits"], is_angle), speed, effort, inertia))
    yield TextTable(("actuator", "coordinate", "limits", "max speed", "max effort", "rotor"), rows)
    yield ""
    for transmission in transmissions:
        yield f"  transmission {transmission['name']} (rad, m): {transmission['equations']}"
    yield ""


def _parameter_order(parameter: JsonMapping) -> tuple[bool, str]:
    """Return a key for sorting: the dimensions of the CAD come last, because there are many."""
    return parameter["name"].startswith("drawing."), parameter["provenance"]


def _parameters(parameters: Sequence[JsonMapping]) -> TextTable:
    rows = []
    for parameter in parameters:
        assumed_mark = "*" if parameter["provenance"] == "ASSUMED" else " "
        value = f"{parameter['shown']:g}"
        if parameter["unit"] != "1":
            value += f" {parameter['unit']}"
        rows.append((assumed_mark + parameter["name"], value, parameter["provenance"], parameter["note"]))
    return TextTable((), rows, fit=True)


def _label(robot: JsonMapping) -> str:
    """Return a robot's name in a scene, followed in parentheses by the name of the built-in robot if it differs."""
    if robot["name"] == robot["robot"]:
        return robot["name"]
    return f"{robot['name']} ({robot['robot']})"


def _point(position_mm: Sequence[float]) -> str:
    x, y, z = position_mm
    return f"{x:.1f}, {y:.1f}, {z:.1f}"
