"""Draw the pictures of the robots in docs/pictures/ from their USD stages read back.

    python docs/make_pictures.py [--out docs/pictures] [--only C lowered]

Bodies, meshes and colours come from `read_stage`, link poses from `read_motion` at the first sample that
stands at the waypoint; viser shows them to a headless Chromium (on the PATH; Debian: apt-get install
chromium), no graphics card needed. Drawn and not measured: what scenery.toml of a robot or a scene names,
floor, trocar (RCM, orange ball and ring), axis of the shaft and, in sils_lowered.png, the patient. Three
minutes for SILS; same bytes again on one machine.
"""

from __future__ import annotations

import argparse
import logging
import queue
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
import viser
from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont
from trimesh.visual.color import linear_to_srgb

import twin
from twin.api.console_runs import operate_console
from twin.cad.build import read_mechanism
from twin.core import assets, spatial
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.model.movable import together
from twin.model.scene import load_scene
from twin.planning.phase_path import rotation
from twin.reference import ReferenceModel
from twin.ui.session.drawn_parts import drawn_parts
from twin.ui.session.patient import patient_of
from twin.ui.viewer.drawn_nodes import DrawnNodes
from twin.usd.read import read_motion, read_stage

FLAGS = (
    "headless no-sandbox use-angle=swiftshader enable-unsafe-swiftshader disable-dev-shm-usage no-first-run "
    "disable-background-networking disable-extensions"
)
SKY, GROUND, INK, ORANGE = (250, 251, 253), (214, 220, 228), (50, 60, 72), (255, 120, 20)
OVERSAMPLING, CREASE = 2, np.radians(35)  # sharper edges stay edges


@dataclass(frozen=True)
class Shot:
    """A picture: where in which protocol, and from where."""

    name: str
    caption: str
    protocol: str
    waypoint: str
    rcm: str  # the waypoint that lies at the trocar; "": the RCM that the protocol registers from the start
    view: tuple[float, ...] = (-39, 18, 25.5)  # azimuth from +x, elevation, vertical field of view, in deg
    target: tuple[float, ...] = (0.003, 0.302, 0.102)
    size: tuple[int, int] = (770, 880)
    patient: bool = False
    robot: str = "sils"
    trocar: float = 0.022  # radius of the ring, in m
    floor: float = -0.42  # in m
    distance: float = 3.0  # of the camera from the target, in m
    folder: str = ""  # of the robot, if it is none of the built-in ones
    scene: str = ""  # instead of one robot: a scene, at `time` in s
    time: float = 0.0

    @property
    def file(self) -> str:
        """Name of the picture's file."""
        return f"{self.robot}.png" if self.name == self.robot else f"{self.robot}_{self.name}.png"


SHOTS = (
    Shot("C", "C  current location", "table2", "c", "b"),
    Shot("B", "B  insertion point", "table2", "b", "b"),
    Shot("I", "I  inserted by 40 mm", "table2", "i", "b"),
    Shot("T", "T′  turned about the RCM", "table2", "t_prime", "b"),
    Shot(
        "lowered", "", "lowered_patient", "far", "port", (-64, 24, 27), (0.26, 0.36, 0.1), (1600, 840), True,
        distance=3.3,
    ),
    Shot(
        "sher", "", "sclerotomy", "nasal", "entry", (-52, 16, 30), (0.21, 0.0, 0.135), (1600, 1000),
        robot="sher", trocar=0.0035, floor=-0.115, distance=1.35,
    ),
    Shot(
        "tilt", "", "sclerotomy", "nasal", "entry", (-62, 14, 21), (0.29, 0.0, 0.185), (1600, 1000),
        robot="sher", trocar=0.0025, floor=-0.115, distance=0.75,
    ),
    Shot(
        "davinci_psm", "", "about_port", "right", "", (-42, 15, 27), (0.0, -0.55, 0.0), (1600, 1000),
        robot="davinci_psm", trocar=0.016, floor=-0.9, distance=2.9,
    ),
    Shot(
        "linkage", "", "about_port", "deep", "", (-62, 11, 21), (0.0, -0.32, 0.12), (1600, 1000),
        robot="davinci_psm", trocar=0.012, floor=-0.9, distance=2.2,
    ),
    Shot(
        "davinci_ecm", "", "look_around", "right", "", (-42, 13, 25), (0.0, -0.42, 0.1), (1600, 1000),
        robot="davinci_ecm", trocar=0.016, floor=-0.9, distance=2.9,
    ),
    Shot(
        "davinci_psm_si", "", "about_port", "right", "", (-42, 15, 27), (0.0, -0.5, 0.0), (1600, 1000),
        robot="davinci_psm_si", trocar=0.016, floor=-0.9, distance=2.6,
    ),
    Shot(
        "bands", "", "about_port", "deep", "", (-24, 12, 17), (0.0, -0.25, 0.14), (1600, 1000),
        robot="davinci_psm_si", trocar=0.012, floor=-0.9, distance=2.3,
    ),
    Shot(
        "raven_left", "", "about_port", "aside", "", (62, 14, 26), (-0.12, 0.0, 0.1), (1600, 1000),
        robot="raven_left", trocar=0.012, floor=-0.35, distance=2.4,
    ),
    Shot(
        "hexapod", "", "tour", "tilted", "level", (-58, 17, 17.4), (0.0, 0.0, 0.166), (1200, 1000),
        robot="hexapod", trocar=0.0, floor=-0.016, distance=1.75, folder="docs/examples/hexapod",
    ),
    Shot(
        "vsrs", "", "", "", "", (-62, 22, 30), (0.08, -0.02, 0.98), (1600, 1000),
        robot="vsrs", floor=0.0, distance=4.2, scene="vsrs", time=9.0,
    ),
    Shot(
        "dome_task", "", "", "", "", (-72, 38, 24), (0.0, 0.045, 0.925), (1600, 1100),
        robot="dome_task", floor=0.6, distance=0.55, scene="raven_dome", time=26.0,
    ),
)  # fmt: skip


def load(shot: Shot) -> twin.Robot:
    """Return the robot of a shot."""
    return twin.load(assets.data_folder() / shot.folder if shot.folder else shot.robot)


def stand(robot: twin.Robot, shot: Shot) -> tuple[Mechanism, dict[str, Array], Array, Array]:
    """Return the mechanism, its link poses at the waypoint, the trocar, and two ends (2, 3) of the shaft's axis."""
    stage = robot.files.usd / f"{robot.name}_{shot.protocol}.usda"
    mechanism, (times, poses), protocol = read_stage(stage), read_motion(stage), robot.protocol(shot.protocol)
    tool, T_tool_moved = mechanism.frame(mechanism.tool), mechanism.frame_in_tool(protocol.frame)
    Ts_tool = poses[tool.body] @ tool.T_body_frame
    way, rcm = protocol.waypoints[shot.waypoint], protocol.waypoints[shot.rcm].position if shot.rcm else protocol.rcm
    R = rotation(way.angles, protocol.rotation)
    axis = T_tool_moved[:3, :3] @ protocol.shaft_axis
    p = rcm + way.depth * R @ axis if way.position is None else way.position
    miss = np.linalg.norm((Ts_tool @ T_tool_moved)[:, :3, 3] - p, axis=1)
    turn = spatial.rotation_angle(R.T @ Ts_tool[:, :3, :3])
    if miss[k := int(np.argmax((miss < 5e-6) & (turn < 5e-5)))] > 5e-6 or turn[k] > 5e-5:
        raise SystemExit(f"{stage} never stands at '{shot.waypoint}': make it new with `twin build {robot.name}`")
    print(f"{shot.name}: {times[k]:.3f} s, {1e6 * miss[k]:.2f} um and {np.degrees(turn[k]):.5f} deg off the waypoint")
    shaft = Ts_tool[k, :3, 3] + np.outer([-0.2, 0.35], Ts_tool[k, :3, :3] @ axis)
    return mechanism, {name: T[k] for name, T in poses.items()}, rcm, shaft


def fill(server: viser.ViserServer, robot: twin.Robot | None, shot: Shot) -> None:
    """Show the robot at the waypoint, floor, lights, trocar, shaft axis and, if asked for, the patient."""
    scene = server.scene
    scene.reset()
    if shot.scene:
        for owner, mechanism, poses in actors(shot):
            add_bodies(scene, mechanism, poses, f"/{owner}", {"patient_abdomen": 0.35})
        file = assets.data_folder() / "cad" / shot.scene / "scene.toml"
        add_drawn(server, file)
        light(scene, shot)
        return
    assert robot is not None
    mechanism, poses, rcm, shaft = stand(robot, shot)
    add_bodies(scene, mechanism, poses, "")
    drawn = drawn_parts(robot.files.description, poses)
    if drawn is not None:
        DrawnNodes(server, "", drawn, poses)
    light(scene, shot)
    if not shot.trocar:
        return
    scene.add_icosphere("/shown/rcm", shot.trocar / 3, ORANGE, position=rcm, cast_shadow=False)
    ring = trimesh.creation.torus(shot.trocar, shot.trocar / 11)
    scene.add_mesh_simple("/shown/trocar", ring.vertices, ring.faces, color=ORANGE, position=rcm, cast_shadow=False)
    scene.add_line_segments("/shown/axis", shaft[None], ORANGE, thickness=shot.trocar / 9)
    if shot.patient:
        add_patient(scene, robot, shot)


def add_drawn(server: viser.ViserServer, file: Path) -> None:
    """Show the drawn parts of a scene."""
    props = load_scene(file).props
    names = () if props is None else [body.name for body in read_mechanism(props, with_mass=False).mechanism.bodies]
    drawn = drawn_parts(file, (), names)
    if drawn is not None:
        DrawnNodes(server, "/drawn", drawn, {})


def add_bodies(
    scene: viser.SceneApi,
    mechanism: Mechanism,
    poses: dict[str, Array],
    under: str,
    clear: dict[str, float] | None = None,
) -> None:
    """Show the meshes of a mechanism at its link poses; `clear` gives some of them an opacity."""
    for body in mechanism.bodies:
        R, p = poses[body.name][:3, :3], poses[body.name][:3, 3]
        place = f"{under}/{body.name}"
        scene.add_frame(place, show_axes=False, wxyz=spatial.quat_from_matrix_wxyz(R), position=p)
        for mesh in body.meshes:
            solid = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
            solid = trimesh.graph.smooth_shade(solid, angle=CREASE, facet_minarea=None)
            color = np.round(255 * linear_to_srgb(np.array(mesh.color_rgba[:3]))).astype(int)
            opacity = clear[mesh.name] if clear and mesh.name in clear else mesh.color_rgba[3]
            see = {"opacity": opacity, "cast_shadow": False} if opacity < 1 else {}
            scene.add_mesh_simple(f"{place}/{mesh.name}", solid.vertices, solid.faces, color=color, **see)


def actors(shot: Shot) -> Iterator[tuple[str, Mechanism, dict[str, Array]]]:
    """Yield name, mechanism and T_world_body of all that a scene holds, at the time of the shot."""
    scene = load_scene(assets.data_folder() / "cad" / shot.scene / "scene.toml")
    if not scene.plays:
        found = operate_console(scene, seed=1)  # the simulated surgeon performs the first task
        k = int(np.argmin(np.abs(found.t - shot.time)))
        for name, arm in found.arms.items():
            yield name, arm.mechanism, {n: arm.place.T_world_base @ T[k] for n, T in arm.links.items()}
        poses = {o.name: found.run.recording[f"{o.name}.pose"][k].reshape(4, 4) for o in scene.objects}
        yield "objects", together(scene.objects), poses | {"objects": np.eye(4)}
    for place in scene.places if scene.plays else ():
        files = twin.load(place.name).files
        stage = files.usd / f"{place.name}_{place.protocol}.usda"
        times, poses = read_motion(stage)
        k = int(np.argmin(np.abs(times - min(shot.time, times[-1]))))
        yield place.name, read_stage(stage), {n: place.T_world_base @ T[k] for n, T in poses.items()}
    if scene.props is not None:
        props = read_mechanism(scene.props, with_mass=False).mechanism
        yield props.name, props, ReferenceModel(props).home().link_poses


def light(scene: viser.SceneApi, shot: Shot) -> None:
    """Light the scene and lay its floor."""
    scene.configure_default_lights(False)
    scene.configure_environment_map("studio", environment_intensity=0.2)
    scene.add_light_directional("/key", intensity=1.7, position=(1.2, -0.7, 2.2), cast_shadow=True)
    scene.add_light_directional("/fill", intensity=0.4, position=(0.6, 2.0, 0.6))
    lines = {"cell_size": 0.1, "section_size": 0.5, "cell_color": (205, 211, 219), "section_color": (186, 194, 204)}
    look = {"fade_distance": 2.4, "fade_from": "origin", "shadow_opacity": 0.35}
    scene.add_grid("/floor", 6, 6, position=(0.2, 0.3, shot.floor), **lines, **look)


def add_patient(scene: viser.SceneApi, robot: twin.Robot, shot: Shot) -> None:
    """Show the patient of the protocol, on a table."""
    patient = patient_of(robot, robot.protocol(shot.protocol), shot.floor)
    assert patient is not None
    add_bodies(scene, patient.mechanism, patient.poses, "/patient")


@contextmanager
def viewer(width: int, height: int) -> Iterator[tuple[viser.ViserServer, viser.ClientHandle]]:
    """Yield a viser server on 127.0.0.1 and the headless Chromium that looks at it."""
    if (program := shutil.which("chromium") or shutil.which("google-chrome")) is None:
        raise SystemExit("neither chromium nor google-chrome is on the PATH (Debian: apt-get install chromium)")
    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # Chromium opens sockets that it never uses
    server = viser.ViserServer(host="127.0.0.1", verbose=False)
    clients: queue.Queue[viser.ClientHandle] = queue.Queue()
    server.on_client_connect(clients.put)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        flags = [f"--{f}" for f in (*FLAGS.split(), f"window-size={width},{height}", f"user-data-dir={profile}")]
        process = subprocess.Popen([program, *flags, f"127.0.0.1:{server.get_port()}"], stderr=subprocess.DEVNULL)
        try:
            yield server, clients.get(timeout=60)
        finally:
            process.terminate()
            process.wait(20)
            server.stop()


def render(server: viser.ViserServer, client: viser.ClientHandle, robot: twin.Robot | None, shot: Shot) -> Image.Image:
    """Return the picture of one shot."""
    fill(server, robot, shot)
    width, height = (OVERSAMPLING * v for v in shot.size)
    a, e, fov = np.radians(shot.view)  # the camera: z forward, y down
    z = -np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    x = np.cross(z, [0.0, 0.0, 1.0]) / np.cos(e)
    wxyz = spatial.quat_from_matrix_wxyz(np.column_stack([x, np.cross(z, x), z]))
    camera = {"wxyz": wxyz, "position": np.array(shot.target) - shot.distance * z, "fov": fov}
    for _ in range(2):  # meshes and light map arrive while the first is drawn
        time.sleep(4)
        front = Image.fromarray(client.get_render(height, width, **camera, transport_format="png", timeout=180))
    shade = np.linspace(0, 1, height)[:, None, None] ** 1.3
    back = Image.fromarray(np.broadcast_to((1 - shade) * SKY + shade * GROUND, (height, width, 3)).astype(np.uint8))
    back.paste(front, mask=front.getchannel("A"))
    return back.resize(shot.size, Image.Resampling.LANCZOS)


def strip(images: dict[Shot, Image.Image], width: int = 400, band: int = 40) -> Image.Image:
    """Return pictures side by side, each with its caption below."""
    height = max(width * i.height // i.width for i in images.values())
    out = Image.new("RGB", (width * len(images), height + band), GROUND)
    font = ImageFont.truetype(font_manager.findfont("DejaVu Sans"), 19)
    for k, (shot, image) in enumerate(images.items()):
        out.paste(image.resize((width, height), Image.Resampling.LANCZOS), (k * width, 0))
        ImageDraw.Draw(out).text(((k + 0.5) * width, height + band / 2), shot.caption, INK, font, anchor="mm")
    return out


def few_colors(image: Image.Image) -> Image.Image:
    """Return the picture in 256 colours; rare ones count by the root of their area, else orange would be lost."""
    colors, areas = np.unique(np.asarray(image).reshape(-1, 3) & 0xFC, axis=0, return_counts=True)
    sample = np.repeat(colors | 2, np.ceil(np.sqrt(areas)).astype(int), axis=0)
    return image.quantize(palette=Image.fromarray(sample[None]).quantize(256, kmeans=3), dither=Image.Dither(3))


def main() -> None:
    """Draw the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=assets.data_folder() / "docs" / "pictures")
    parser.add_argument("--only", nargs="+", choices=[s.name for s in SHOTS], help="default: all, and the strip")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    shots = [s for s in SHOTS if not args.only or s.name in args.only]
    with viewer(*(OVERSAMPLING * max(s.size[i] for s in shots) + 200 for i in (0, 1))) as (server, client):
        images = {s: render(server, client, None if s.scene else load(s), s) for s in shots}
    pictures = {s.file: image for s, image in images.items()}
    if not args.only:
        pictures["sils_table2.png"] = strip({s: i for s, i in images.items() if s.caption})
    for name, image in pictures.items():
        few_colors(image).save(args.out / name, optimize=True)
        print(f"{args.out / name}: {image.width} x {image.height}, {(args.out / name).stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
