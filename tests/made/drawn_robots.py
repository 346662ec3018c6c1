"""Draw robots at random, and write them as URDF, MJCF, SDF or USD by hand; the poses of their links are computed here.

A robot is a tree of links. Its stand is the origin, a mount (wall, ceiling, oblique), or a floating base. Joints are
hinges and slides with any axis, with limits around zero, without zero, on one side, or without limits; joints may
follow others. MJCF joints have a `ref` and a pivot beside the origin of the link; stages have any up axis and unit.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import trimesh
from pxr import Gf, Usd, UsdGeom, UsdPhysics

from twin.core import spatial

MESHES = {"mjcf": ("box", "stl", "obj"), "usd": ("mesh",), "urdf": ("box", "stl", "obj", "glb", "dae")}
MESHES["sdf"] = MESHES["urdf"]
"""Shapes of the links by format: a primitive, a mesh of a stage, or a box in a mesh file of one of these formats."""

AXES = ("X_UP", "Y_UP", "Z_UP")
"""Values of up_axis in a Collada file; programs that read URDF and SDF ignore it."""

R_GLTF_WORLD = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""Rotation (3, 3) from z up to the axes of glTF."""

R_STAGE_WORLD = {"Z": np.eye(3), "Y": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])}
"""Rotation from a world with z up to the axes of a stage, by the up axis of the stage."""


@dataclass(frozen=True)
class Link:
    """A link and the joint to its parent.

    Attributes:
        name: name in the file.
        parent: number of the parent; -1 for the root.
        kind: "hinge", "slide" or "fixed".
        T: pose (4, 4) of the link in its parent, where the joint is at `ref`.
        axis: unit vector (3,) in the link.
        pivot: point (3,) of the hinge's axis in the link, in m.
        ref: coordinate in rad or m at which the link has the pose T.
        limits: (lower, upper) in rad or m, infinite on an open side; None without limits.
        follows: (number of the leading link, multiplier, offset); None for a joint of its own.
        size: edges (3,) of the box in m.
        center: centre (3,) of the box, which is the mass centre, in m.
        mass: in kg; 0 if not stated.
        shape: one of MESHES; "" without shape.
        file_axes, file_unit: up axis and unit in m of a Collada file.
    """

    name: str
    parent: int
    kind: str
    T: np.ndarray
    axis: np.ndarray
    pivot: np.ndarray = field(default_factory=lambda: np.zeros(3))
    ref: float = 0.0
    limits: tuple[float, float] | None = None
    follows: tuple[int, float, float] | None = None
    size: tuple[float, float, float] = (0.1, 0.1, 0.1)
    center: np.ndarray = field(default_factory=lambda: np.zeros(3))
    mass: float = 0.0
    shape: str = ""
    file_axes: str = "Z_UP"
    file_unit: float = 1.0

    @property
    def joint(self) -> str:
        """Name of the joint to the parent."""
        return f"{self.name}_joint"

    @property
    def moments(self) -> np.ndarray:
        """Principal moments of inertia (3,) in kg m2 of the box."""
        squares = np.square(self.size)
        return self.mass / 12.0 * (squares.sum() - squares)

    def pose(self, q: float) -> np.ndarray:
        """Return the pose (4, 4) of the link in its parent at the coordinate q in rad or m."""
        if self.kind == "fixed":
            return self.T
        if self.kind == "slide":
            return self.T @ spatial.pose(p=(q - self.ref) * self.axis)
        there = spatial.pose(p=self.pivot)
        return self.T @ there @ spatial.pose(spatial.exp_so3((q - self.ref) * self.axis)) @ spatial.inverse(there)


@dataclass(frozen=True)
class Robot:
    """A drawn robot: its links, and how it stands.

    Attributes:
        format: "urdf", "mjcf", "sdf" or "usd".
        stand: "origin", "mount" or "floating".
        T_world_root: pose (4, 4) of the root in the world, z up.
        gravity: (3,) in m/s2 in the world; None if the file states none.
        up, meters: up axis and unit of the stage.
    """

    format: str
    links: tuple[Link, ...]
    stand: str
    T_world_root: np.ndarray
    gravity: tuple[float, float, float] | None
    up: str = "Z"
    meters: float = 1.0

    @property
    def driven(self) -> list[Link]:
        """The links whose joints have a coordinate of their own."""
        return [k for k in self.links if k.kind != "fixed" and k.follows is None]

    def coordinates(self, own: dict[str, float]) -> dict[str, float]:
        """Return {joint: coordinate} of all joints for the coordinates of the driven joints."""
        out = dict(own)
        for link in self.links:  # a leader comes before its follower
            if link.follows is not None:
                leader, multiplier, offset = link.follows
                out[link.joint] = multiplier * out[self.links[leader].joint] + offset
        return out

    def poses(self, own: dict[str, float]) -> dict[str, np.ndarray]:
        """Return {link: T_world_link (4, 4)} for the coordinates of the driven joints."""
        q, out = self.coordinates(own), {}
        for link in self.links:
            if link.parent < 0:
                out[link.name] = self.T_world_root
            else:
                out[link.name] = out[self.links[link.parent].name] @ link.pose(q.get(link.joint, 0.0))
        return out

    def drawn_coordinates(self, rng: random.Random) -> dict[str, float]:
        """Return coordinates of the driven joints within the limits of all joints."""
        out = {}
        for link in self.driven:
            low, high = link.limits or (-np.inf, np.inf)
            reach = 0.8 if link.kind == "hinge" else 0.3
            if not np.isfinite(low):
                low = min(high, reach) - 2 * reach if np.isfinite(high) else -reach
            if not np.isfinite(high):
                high = low + reach
            out[link.joint] = rng.uniform(low, high)
        return out


def draw(seed: int, format: str) -> Robot:
    """Return the robot of a seed in a format."""
    rng = random.Random(f"{format} {seed}")
    stand = rng.choice(["origin", "mount", "mount", "floating"])
    T_world_root = np.eye(4) if stand == "origin" else _stand(rng)
    links: list[Link] = [replace(_link(rng, 0, format), parent=-1, kind="fixed", limits=None)]
    for i in range(1, rng.randint(2, 6)):
        link = replace(_link(rng, i, format), parent=rng.randrange(max(0, i - 2), i))
        links.append(_coupled(rng, links, link, format))
    if all(k.kind == "fixed" or k.follows for k in links):
        links.append(replace(_link(rng, len(links), format), parent=len(links) - 1, kind="hinge", follows=None))
    if format == "urdf" and rng.random() < 0.2:  # a link of this name may be any link, with a shape or without
        named = rng.randrange(len(links))
        if stand == "origin":
            links[named] = replace(links[named], name="world")
    gravity = None
    if format != "urdf" and rng.random() < 0.5:
        gravity = rng.choice([(0.0, 0.0, -9.81), (0.0, 0.0, -1.62), (0.0, 0.0, 0.0), (0.0, -6.0, -8.0)])
    up, meters = "Z", 1.0
    if format == "usd":
        up, meters = rng.choice("ZY"), rng.choice([1.0, 0.01, 0.001])
    return Robot(format, tuple(links), stand, T_world_root, gravity, up, meters)


def _stand(rng: random.Random) -> np.ndarray:
    quarter = np.pi / 2
    wall = [(0.0, quarter, 0.0), (-quarter, 0.0, 0.0), (np.pi, 0.0, 0.0), (0.0, 0.0, 0.0)]
    angles = rng.choice([*wall, tuple(rng.uniform(-1.5, 1.5) for _ in range(3))])
    return spatial.pose(_rotation(angles), [rng.uniform(-2, 2) for _ in range(3)])


def _rotation(angles) -> np.ndarray:
    x, y, z = np.eye(3)
    return spatial.exp_so3(angles[2] * z) @ spatial.exp_so3(angles[1] * y) @ spatial.exp_so3(angles[0] * x)


def _link(rng: random.Random, i: int, format: str) -> Link:
    kind = rng.choice(["hinge", "hinge", "slide", "fixed"])
    axis = np.array(rng.choice([(1, 0, 0), (0, 1, 0), (0, 0, -1), None]) or [rng.uniform(-1, 1) for _ in range(3)])
    if format == "usd":  # the axis of a joint is an axis of its frame
        axis = np.array(rng.choice([(1, 0, 0), (0, 1, 0), (0, 0, 1)]))
    T = spatial.pose(_rotation([rng.uniform(-1.5, 1.5) for _ in range(3)]), [rng.uniform(-0.5, 0.5) for _ in range(3)])
    size = tuple(rng.uniform(0.05, 0.4) for _ in range(3))
    heavy = i == 0 or format == "mjcf" or rng.random() < 0.8  # MuJoCo refuses bodies without mass
    pivot = np.zeros(3)
    if format != "urdf" and kind == "hinge" and rng.random() < 0.5:
        pivot = np.array([rng.uniform(-0.2, 0.2) for _ in range(3)])
    ref = rng.choice([0.0, 0.3, -0.2]) if format == "mjcf" and kind != "fixed" else 0.0
    name = rng.choice(["link{}", "Arm{}", "upper_arm_{}", "L{}_x"]).format(i)
    return Link(
        name,
        i - 1,
        kind,
        T,
        axis / np.linalg.norm(axis),
        pivot,
        ref,
        _limits(rng, kind),
        None,
        size,
        np.array([rng.uniform(-0.1, 0.1) for _ in range(3)]),
        1000.0 * float(np.prod(size)) if heavy else 0.0,
        rng.choice([*MESHES[format], *MESHES[format], ""]) if i else rng.choice(MESHES[format]),
        rng.choice(AXES),
        rng.choice([1.0, 0.001, 0.0254]),
    )


def _limits(rng: random.Random, kind: str) -> tuple[float, float] | None:
    if kind == "fixed":
        return None
    unit = 1.0 if kind == "hinge" else 0.3
    around, above, below = (-1.2, 1.4), (0.4, 1.5), (-1.6, -0.3)
    low, high = rng.choice([around, around, above, below, (0.0, 1.0), (-np.inf, np.inf)])
    return None if np.isinf(low) else (low * unit, high * unit)


def _coupled(rng: random.Random, links: list[Link], link: Link, format: str) -> Link:
    """Return the link, in one of three cases with a joint that follows an earlier one, also a hinge a slide."""
    leaders = [n for n, k in enumerate(links) if k.kind != "fixed"]
    if format == "usd" or link.kind == "fixed" or not leaders or rng.random() > 0.35:
        return link
    leader = rng.choice(leaders)
    multiplier = rng.choice([1.0, -1.0, 0.5, -2.0])
    if links[leader].kind != link.kind:
        multiplier *= 0.05 if link.kind == "slide" else 5.0
    offset = rng.choice([0.0, 0.0, 0.1, -0.05])
    return replace(link, follows=(leader, multiplier, offset), limits=None)


# --- writing ---------------------------------------------------------------------------------------


def write(robot: Robot, folder: Path) -> Path:
    """Write the robot and its mesh files; return the path of the robot's file."""
    folder.mkdir(parents=True, exist_ok=True)
    for link in robot.links:
        if link.shape not in ("", "box", "mesh"):
            box = trimesh.creation.box(link.size)
            box.apply_translation(link.center)
            path = folder / f"{link.name}.{link.shape}"
            if link.shape == "dae":
                path.write_text(_collada(link, box))
                continue
            if link.shape == "glb":
                box.apply_transform(spatial.pose(R_GLTF_WORLD))
            box.export(path)
    return {"urdf": _urdf, "mjcf": _mjcf, "sdf": _sdf, "usd": _usd}[robot.format](robot, folder)


def text(values) -> str:
    """Return numbers with all their digits, separated by spaces."""
    return " ".join(f"{float(v):.17g}" for v in values)


def _collada(link: Link, box: trimesh.Trimesh) -> str:
    """Return a Collada file of a box in the unit of the link's file, whose up axis has no effect."""
    points = text((box.vertices / link.file_unit).ravel())
    corners = " ".join(str(i) for i in box.faces.ravel())
    count = box.vertices.size
    return (
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>'
        f'<unit name="u" meter="{link.file_unit}"/><up_axis>{link.file_axes}</up_axis></asset><library_geometries>'
        f'<geometry id="g"><mesh><source id="p"><float_array id="a" count="{count}">{points}</float_array>'
        f'<technique_common><accessor source="#a" count="{count // 3}" stride="3"><param name="X" type="float"/>'
        '<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>'
        '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
        f'<triangles count="{len(box.faces)}"><input semantic="VERTEX" source="#v" offset="0"/><p>{corners}</p>'
        "</triangles></mesh></geometry></library_geometries><library_visual_scenes>"
        '<visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node></visual_scene>'
        '</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )


def _rpy(T) -> str:
    return text(spatial.euler_angles(T[:3, :3], "zyx")[::-1])


def _urdf(robot: Robot, folder: Path) -> Path:
    lines = ['<robot name="drawn">']
    kinds = {"hinge": "revolute", "slide": "prismatic", "fixed": "fixed"}
    for link in robot.links:
        lines.append(f'<link name="{link.name}">')
        if link.mass:
            xx, yy, zz = link.moments
            lines.append(
                f'<inertial><origin xyz="{text(link.center)}"/><mass value="{link.mass:.17g}"/>'
                f'<inertia ixx="{xx:.17g}" iyy="{yy:.17g}" izz="{zz:.17g}" ixy="0" ixz="0" iyz="0"/></inertial>'
            )
        if link.shape:
            box = f'<origin xyz="{text(link.center)}"/><geometry><box size="{text(link.size)}"/></geometry>'
            file = f'<geometry><mesh filename="{link.name}.{link.shape}"/></geometry>'
            shape = box if link.shape == "box" else file
            lines.append(f"<visual>{shape}</visual><collision>{shape}</collision>")
        lines.append("</link>")
    if robot.stand != "origin":
        lines.append(
            f'<link name="world"/><joint name="stand" type="{"fixed" if robot.stand == "mount" else "floating"}">'
            f'<parent link="world"/><child link="{robot.links[0].name}"/>'
            f'<origin xyz="{text(robot.T_world_root[:3, 3])}" rpy="{_rpy(robot.T_world_root)}"/></joint>'
        )
    for link in robot.links[1:]:
        kind = "continuous" if link.kind == "hinge" and link.limits is None else kinds[link.kind]
        low, high = link.limits or (-100.0, 100.0)
        lines.append(
            f'<joint name="{link.joint}" type="{kind}"><parent link="{robot.links[link.parent].name}"/>'
            f'<child link="{link.name}"/><origin xyz="{text(link.T[:3, 3])}" rpy="{_rpy(link.T)}"/>'
        )
        if link.kind != "fixed":
            limit = f'lower="{low:.17g}" upper="{high:.17g}" ' if kind != "continuous" else ""
            lines.append(f'<axis xyz="{text(link.axis)}"/><limit {limit}effort="1e5" velocity="2"/>')
        if link.follows is not None:
            leader, multiplier, offset = link.follows
            named = f'joint="{robot.links[leader].joint}" multiplier="{multiplier}" offset="{offset}"'
            lines.append(f"<mimic {named}/>")
        lines.append("</joint>")
    path = folder / "drawn.urdf"
    path.write_text("\n".join([*lines, "</robot>"]))
    return path


def _mjcf(robot: Robot, folder: Path) -> Path:
    gravity = "" if robot.gravity is None else f'<option gravity="{text(robot.gravity)}"/>'
    files = [k for k in robot.links if k.shape not in ("", "box")]
    assets = "".join(f'<mesh name="{k.name}" file="{k.name}.{k.shape}"/>' for k in files)
    lines = [f'<mujoco model="drawn"><compiler angle="radian" autolimits="true"/>{gravity}<asset>{assets}</asset>']
    lines.append(f"<worldbody>{_mjcf_body(robot, 0)}</worldbody><actuator>")
    lines += [f'<position joint="{k.joint}" kp="10" kv="1"/>' for k in robot.driven]
    lines.append("</actuator><equality>")
    for link in robot.links:
        if link.follows is not None:
            leader, multiplier, offset = link.follows
            first = robot.links[leader]
            shift = offset + multiplier * first.ref - link.ref  # MuJoCo's polynomial is in coordinates from `ref`
            ends = f'joint1="{link.joint}" joint2="{first.joint}"'
            lines.append(f'<joint {ends} polycoef="{shift:.17g} {multiplier:.17g} 0 0 0"/>')
    lines.append("</equality>")
    joints = [k for k in _in_depth(robot, 0) if k.kind != "fixed"]
    start = robot.coordinates({k.joint: k.ref if k.limits is None else float(np.mean(k.limits)) for k in robot.driven})
    place = [*robot.T_world_root[:3, 3], *spatial.quat_from_matrix_wxyz(robot.T_world_root[:3, :3])]
    qpos = [*(place if robot.stand == "floating" else ()), *(start[k.joint] for k in joints)]
    if len(robot.links) % 2:
        lines.append(f'<keyframe><key name="ready" qpos="{text(qpos)}"/></keyframe>')
    lines.append("</mujoco>")
    path = folder / "drawn.xml"
    path.write_text("\n".join(lines))
    return path


def _in_depth(robot: Robot, i: int) -> list[Link]:
    """Return a link and all links beyond it in the order of MuJoCo."""
    out = [robot.links[i]]
    for n, link in enumerate(robot.links):
        if link.parent == i:
            out += _in_depth(robot, n)
    return out


def _mjcf_body(robot: Robot, i: int) -> str:
    link = robot.links[i]
    T = robot.T_world_root if i == 0 else link.T
    quat = spatial.quat_from_matrix_wxyz(T[:3, :3])
    lines = [f'<body name="{link.name}" pos="{text(T[:3, 3])}" quat="{text(quat)}">']
    if i == 0 and robot.stand == "floating":
        lines.append('<freejoint name="stand"/>')
    if link.kind != "fixed":
        limits = "" if link.limits is None else f' range="{text(link.limits)}"'
        line = f'pos="{text(link.pivot)}" axis="{text(link.axis)}" ref="{link.ref:.17g}"{limits}'
        lines.append(f'<joint name="{link.joint}" type="{link.kind}" {line}/>')
    place = f'pos="{text(link.center)}"'
    lines.append(f'<inertial {place} mass="{link.mass:.17g}" diaginertia="{text(link.moments)}"/>')
    if link.shape == "box":
        lines.append(f'<geom type="box" pos="{text(link.center)}" size="{text(np.divide(link.size, 2))}"/>')
    elif link.shape:
        lines.append(f'<geom type="mesh" mesh="{link.name}"/>')
    lines += [_mjcf_body(robot, n) for n, k in enumerate(robot.links) if k.parent == i]
    return "".join([*lines, "</body>"])


def _sdf(robot: Robot, folder: Path) -> Path:
    T_model_root = spatial.pose(spatial.exp_so3([0.1, 0.2, -0.3]), [0.05, 0.0, 0.02])  # the root need not be the origin
    T_world_model = robot.T_world_root @ spatial.inverse(T_model_root)
    static = "<static>true</static>" if robot.stand == "origin" else ""
    lines = [f'<model name="drawn">{static}<pose>{text(T_world_model[:3, 3])} {_rpy(T_world_model)}</pose>']
    for link in robot.links:
        parent = "" if link.parent < 0 else f' relative_to="{robot.links[link.parent].name}"'
        T = T_model_root if link.parent < 0 else link.T
        lines.append(f'<link name="{link.name}"><pose{parent}>{text(T[:3, 3])} {_rpy(T)}</pose>')
        if link.mass:
            xx, yy, zz = link.moments
            tensor = f"<ixx>{xx:.17g}</ixx><iyy>{yy:.17g}</iyy><izz>{zz:.17g}</izz>"
            at = f"<pose>{text(link.center)} 0 0 0</pose><mass>{link.mass:.17g}</mass>"
            lines.append(f"<inertial>{at}<inertia>{tensor}</inertia></inertial>")
        if link.shape:
            box = f"<box><size>{text(link.size)}</size></box>"
            shape = box if link.shape == "box" else f"<mesh><uri>{link.name}.{link.shape}</uri></mesh>"
            at = f"<pose>{text(link.center)} 0 0 0</pose>" if link.shape == "box" else ""
            uses = ("visual", "collision")
            lines += [f'<{use} name="{use}">{at}<geometry>{shape}</geometry></{use}>' for use in uses]
        lines.append("</link>")
    if robot.stand == "mount":
        parts = f"<parent>world</parent><child>{robot.links[0].name}</child>"
        lines.append(f'<joint name="stand" type="fixed">{parts}</joint>')
    kinds = {"hinge": "revolute", "slide": "prismatic", "fixed": "fixed"}
    for link in robot.links[1:]:
        at = f"<pose>{text(link.pivot)} 0 0 0</pose>"
        lines.append(f'<joint name="{link.joint}" type="{kinds[link.kind]}">{at}')
        lines.append(f"<parent>{robot.links[link.parent].name}</parent><child>{link.name}</child>")
        if link.kind != "fixed":
            low, high = link.limits or (-1e16, 1e16)
            limit = f"<limit><lower>{low:.17g}</lower><upper>{high:.17g}</upper></limit>"
            mimic = ""
            if link.follows is not None:
                leader, multiplier, offset = link.follows
                numbers = f"<multiplier>{multiplier}</multiplier><offset>{offset}</offset><reference>0</reference>"
                mimic = f'<mimic joint="{robot.links[leader].joint}">{numbers}</mimic>'
            lines.append(f"<axis><xyz>{text(link.axis)}</xyz>{limit}{mimic}</axis>")
        lines.append("</joint>")
    lines.append("</model>")
    if robot.gravity is not None:
        lines = [f'<world name="w"><gravity>{text(robot.gravity)}</gravity>', *lines, "</world>"]
    path = folder / "drawn.sdf"
    path.write_text("\n".join(['<sdf version="1.11">', *lines, "</sdf>"]))
    return path


def _usd(robot: Robot, folder: Path) -> Path:
    path = folder / "drawn.usda"
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, robot.up)
    UsdGeom.SetStageMetersPerUnit(stage, robot.meters)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/drawn").GetPrim())
    UsdPhysics.ArticulationRootAPI.Apply(stage.GetDefaultPrim())
    R = R_STAGE_WORLD[robot.up]
    still = {k.joint: k.ref for k in robot.driven}
    for link in robot.links:
        T = spatial.pose(R) @ robot.poses(still)[link.name]
        body = UsdGeom.Xform.Define(stage, f"/drawn/{link.name}")
        body.AddTranslateOp().Set(Gf.Vec3d(*(T[:3, 3] / robot.meters).tolist()))
        w, *xyz = spatial.quat_from_matrix_wxyz(T[:3, :3]).tolist()
        body.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Quatd(w, *xyz))
        UsdPhysics.RigidBodyAPI.Apply(body.GetPrim())
        if link.mass:
            mass = UsdPhysics.MassAPI.Apply(body.GetPrim())
            mass.CreateMassAttr(link.mass)
            mass.CreateCenterOfMassAttr(Gf.Vec3f(*(link.center / robot.meters).tolist()))
            mass.CreateDiagonalInertiaAttr(Gf.Vec3f(*(link.moments / robot.meters**2).tolist()))
        if link.shape:
            box = trimesh.creation.box(link.size)
            mesh = UsdGeom.Mesh.Define(stage, f"/drawn/{link.name}/{link.name}_shape")
            points = (box.vertices + link.center) / robot.meters
            mesh.CreatePointsAttr([Gf.Vec3f(*p) for p in points.tolist()])
            mesh.CreateFaceVertexCountsAttr([3] * len(box.faces))
            mesh.CreateFaceVertexIndicesAttr(box.faces.ravel().tolist())
            UsdPhysics.CollisionAPI.Apply(mesh.GetPrim())
    schemas = {"hinge": UsdPhysics.RevoluteJoint, "slide": UsdPhysics.PrismaticJoint, "fixed": UsdPhysics.FixedJoint}
    if robot.stand != "floating":
        anchor = UsdPhysics.FixedJoint.Define(stage, "/drawn/stand")
        anchor.CreateBody1Rel().SetTargets([f"/drawn/{robot.links[0].name}"])
        frame(anchor, 0, spatial.pose(R) @ robot.T_world_root, robot.meters)
    for link in robot.links[1:]:
        joint = schemas[link.kind].Define(stage, f"/drawn/{link.joint}")
        joint.CreateBody0Rel().SetTargets([f"/drawn/{robot.links[link.parent].name}"])
        joint.CreateBody1Rel().SetTargets([f"/drawn/{link.name}"])
        frame(joint, 0, link.T @ spatial.pose(p=link.pivot), robot.meters)
        frame(joint, 1, spatial.pose(p=link.pivot), robot.meters)
        if link.kind == "fixed":
            continue
        joint.CreateAxisAttr("XYZ"[int(np.argmax(np.abs(link.axis)))])
        if link.limits is not None:
            unit = np.pi / 180 if link.kind == "hinge" else robot.meters
            joint.CreateLowerLimitAttr(link.limits[0] / unit)
            joint.CreateUpperLimitAttr(link.limits[1] / unit)
    if robot.gravity is not None:
        scene = UsdPhysics.Scene.Define(stage, "/scene")
        size = float(np.linalg.norm(robot.gravity))
        down = R @ (np.array(robot.gravity) / size if size else np.array([0.0, 0.0, -1.0]))
        scene.CreateGravityDirectionAttr(Gf.Vec3f(*down.tolist()))
        scene.CreateGravityMagnitudeAttr(size / robot.meters)
    stage.GetRootLayer().Save()
    return path


def frame(joint, side: int, T: np.ndarray, meters: float) -> None:
    """Set the frame of one side of a joint; UsdPhysics has it in single precision."""
    position, rotation = (joint.CreateLocalPos0Attr, joint.CreateLocalRot0Attr)
    if side:
        position, rotation = (joint.CreateLocalPos1Attr, joint.CreateLocalRot1Attr)
    w, *xyz = spatial.quat_from_matrix_wxyz(T[:3, :3]).tolist()
    position(Gf.Vec3f(*(T[:3, 3] / meters).tolist()))
    rotation(Gf.Quatf(w, *xyz))
