"""Facts about a robot or a scene, and the list of built-in robots and scenes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from twin.api.robot import Progress, Robot, silent
from twin.core import assets
from twin.core.findings import Finding
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.result import Part, Result, Table
from twin.core.units import MM, display_unit

if TYPE_CHECKING:
    from twin.core.provenance import Parameter
    from twin.model.joint import Joint
    from twin.model.mechanism import Mechanism
    from twin.model.scene import Scene

SCENE_COMMANDS = ("info", "run", "view", "serve", "export")
"""Commands that accept a scene in which every robot has a protocol."""


def scene_commands(scene: Scene) -> tuple[str, ...]:
    """Return the twin commands that accept a scene.

    "run" and "export" require a protocol for every robot. "run" also requires that no robot plays a protocol file of
    the scene, because USD stages contain only the motions of the robots' own protocols. "operate" requires tasks or
    machines.
    """
    operated = ("operate",) if scene.tasks or scene.trainer is not None else ()
    played = [c for c in SCENE_COMMANDS if c != "run" or not any(p.protocol.endswith(".toml") for p in scene.places)]
    return (*(played if scene.plays else ("info", "view", "serve")), *operated)


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
        loops = [j["name"] for j in data["joints"] if j["closes_loop"]]
        yield f"{data['name']}: {data['title']}" if data["title"] else data["name"]
        yield f"  {data['source']}\n"
        yield (
            f"  {self.bodies} bodies, {len(data['joints'])} joints, {data['degrees_of_freedom']} degrees of freedom, "
            f"{data['redundant_constraints']} redundant constraints; "
            + (f"loops closed by {', '.join(loops)}" if loops else "no loops")
        )
        for name, r in data["redundant"].items():
            yield f"    loop {name}: {r['count']} of its constraints {', '.join(r['among'])} are redundant"
        yield f"  frames: {', '.join(data['frames'])}   points: {', '.join(data['points']) or 'none'}\n"
        yield Table(("joint", "type", "between", "limits", ""), [_joint_row(j) for j in data["joints"]])
        yield ""
        yield from _motors(data["actuators"], data["transmissions"])
        yield "  equations and their variants (* in use)" if data["variants"] else "  no equations"
        for name, choices in data["variants"].items():
            for variant, reason in choices.items():
                used = "*" if data["chosen"][name] == variant else " "
                yield f"  {used}{name}={variant}" + (f": {reason}" if reason else "")
        if data["parameters"]:
            yield "\n  parameters (* assumed: not published)"
            # The dimensions of the CAD come last, because there are many.
            yield _parameters(
                sorted(data["parameters"], key=lambda p: (p["name"].startswith("drawing."), p["provenance"]))
            )
        yield from self.findings


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
        rows = [
            (
                _label(r),
                r["protocol"],
                r["port"],
                _point(r["port_mm"]),
                _point(r["position_mm"]),
            )
            for r in data["robots"]
        ]
        yield Table(("robot", "protocol", "port", "port position [mm]", "base position [mm]"), rows)
        around = data["surroundings"] or "none"
        yield f"\n  surroundings: {around}; required clearance: {data['clearance_mm']:g} mm"
        yield "\n".join(f"  camera {n}: {c['robot']}, frame {c['frame']}" for n, c in data["cameras"].items())
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
        yes = {True: "yes", False: "-"}
        yield Table(
            ("robot", "title", "equations", "stage", "protocols"),
            [
                (r["name"], r["title"], yes[r["equations"]], yes[r["stage"]], ", ".join(r["protocols"]))
                for r in self.robots
            ],
        )
        yield ""
        yield Table(
            ("scene", "title", "robots"), [(s["name"], s["title"], ", ".join(s["robots"])) for s in self.scenes]
        )


def info(robot: Robot, progress: Progress = silent) -> Info:
    """Return the joints, limits, frames, variants and parameters of a robot.

    Raises:
        TwinError: the robot's description, CAD, stage or equations are malformed.
    """
    from twin.reference.regular import singular_home

    progress("read CAD", 0.0)
    mechanism, model = robot.mechanism, robot.reference()
    home = model.home().x
    mobility = model.mobility(home)
    formula, chosen = None, {}
    if robot.files is not None and robot.files.has_equations:
        kin = robot.kinematics()
        formula, chosen = kin.formula, kin.variants
    cad = robot.cad if robot.files is not None else None
    equations = [e for e in formula.equations if e.stage != "helper"] if formula else []
    numbers = (
        *(formula.parameters if formula else ()),
        *mechanism.parameters,
        *(cad.dimensions if cad else ()),
    )
    data = {
        "name": robot.name,
        "title": cad.description.title if cad else "",
        "source": formula.source if formula else cad.description.source if cad else mechanism.source,
        "degrees_of_freedom": mobility.freedom,
        "redundant_constraints": mobility.redundancy,
        "redundant": {n: {"count": c, "among": mobility.repeated[n]} for n, c in mobility.redundant.items() if c},
        "joints": [_joint(j, mechanism) for j in mechanism.joints],
        "actuators": [vars(a) for a in mechanism.actuators],
        "transmissions": [
            {"name": t.name, "joints": t.joints, "actuators": t.actuators, "matrix": t.matrix.tolist()}
            | {"equations": t.equations}
            for t in mechanism.transmissions
        ],
        "frames": [f.name for f in mechanism.frames],
        "points": [p.name for p in mechanism.points],
        "variants": {e.name: {n: e.reasons.get(n, "") for n in e.variants} for e in equations},
        "chosen": dict(chosen),
        "parameters": [vars(p) for p in numbers],
    }
    return Info(data, len(mechanism.bodies), (*(cad.findings if cad else ()), *singular_home(model, home)))


def info_of_scene(scene: Scene, word: str) -> SceneInfo:
    """Return the robots, props, parameters and commands of a scene; `word` names the scene in the commands."""
    parameters: Sequence[Parameter] = scene.parameters
    return SceneInfo(
        {
            "name": scene.name,
            "title": scene.title,
            "source": scene.source,
            "robots": [
                {
                    "name": p.name,
                    "robot": p.robot,
                    "protocol": p.protocol_name,
                    "port": p.port,
                    "port_mm": (next(iter(p.p_world_ports.values())) / MM).tolist(),
                    "position_mm": (p.T_world_base[:3, 3] / MM).tolist(),
                }
                for p in scene.places
            ],
            "cameras": {n: {"robot": c.robot, "frame": c.frame} for n, c in scene.cameras.items()},
            "surroundings": None if scene.props is None else scene.props.stem,
            "clearance_mm": scene.clearance / MM,
            "touching": sorted(sorted(t) for t in scene.touching),
            "parameters": [vars(p) for p in parameters],
            "commands": [f"twin {c} {word}" for c in scene_commands(scene)],
        }
    )


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
    scenes = [load_scene(assets.data_folder() / "cad" / n / "scene.toml") for n in assets.scenes()]
    told = [{"kind": "scene", "name": s.name, "title": s.title, "robots": [p.robot for p in s.places]} for s in scenes]
    return Listing(robots, told)


def _joint(j: Joint, mechanism: Mechanism) -> JsonObject:
    return {
        "name": j.name,
        "type": j.type,
        "parent": j.parent,
        "child": j.child,
        "active": j.active,
        "auxiliary": j in mechanism.auxiliary,
        "limits": j.limits,
        "closes_loop": j in mechanism.loops,
    }


def _joint_row(j: JsonMapping) -> tuple[str, ...]:
    limits = _range(j["limits"], j["type"] == "revolute")
    role = "auxiliary" if j["auxiliary"] else "driven" if j["active"] else "closes a loop" if j["closes_loop"] else ""
    return j["name"], j["type"], f"{j['parent']} -> {j['child']}", limits, role


def _range(limits: Sequence[float] | None, angle: bool) -> str:
    unit, scale = display_unit(angle)
    return "" if limits is None else f"{limits[0] / scale:g} .. {limits[1] / scale:g} {unit}"


def _motors(actuators: Sequence[JsonMapping], transmissions: Sequence[JsonMapping]) -> Iterator[Part]:
    """Yield a table of the motors and a line for each transmission; without transmissions, yield nothing."""
    if not transmissions:
        return
    rows = []
    for a in actuators:
        angle = a["kind"] == "angle"
        (unit, scale), effort = display_unit(angle), "N m" if angle else "N"
        speed = "" if a["max_speed"] is None else f"{a['max_speed'] / scale:g} {unit}/s"
        force = "" if a["max_effort"] is None else f"{a['max_effort']:g} {effort}"
        inertia = "" if a["rotor_inertia"] is None else f"{a['rotor_inertia']:g} {'kg m2' if angle else 'kg'}"
        rows.append((a["name"], a["kind"], _range(a["limits"], angle), speed, force, inertia))
    yield Table(("actuator", "coordinate", "limits", "max speed", "max effort", "rotor"), rows)
    yield ""
    for t in transmissions:
        yield f"  transmission {t['name']} (rad, m): {t['equations']}"
    yield ""


def _parameters(parameters: Sequence[JsonMapping]) -> Table:
    marks = ["*" if p["provenance"] == "ASSUMED" else " " for p in parameters]
    rows = [
        (
            mark + p["name"],
            f"{p['shown']:g}" + ("" if p["unit"] == "1" else f" {p['unit']}"),
            p["provenance"],
            p["note"],
        )
        for mark, p in zip(marks, parameters, strict=True)
    ]
    return Table((), rows, fit=True)


def _label(r: JsonMapping) -> str:
    """Return a robot's name in a scene, followed in parentheses by the name of the built-in robot if it differs."""
    return r["name"] if r["name"] == r["robot"] else f"{r['name']} ({r['robot']})"


def _point(mm: Sequence[float]) -> str:
    return ", ".join(f"{v:.1f}" for v in mm)
