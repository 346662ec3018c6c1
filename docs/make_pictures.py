"""Draw the pictures of the SILS robot in docs/pictures/ from its USD stage read back.

    python docs/make_pictures.py [--out docs/pictures] [--only lowered C]

Needs Chromium on the PATH (Debian: apt-get install chromium); no graphics card. Bodies, meshes and colours
come from `read_stage`, link poses from `read_motion` at the sample that stands at the waypoint; viser shows
them to a headless Chromium, which renders. Drawn by this script alone, as props: the floor, the trocar (RCM)
as an orange ball, the axis of the shaft, and in sils_lowered.png the operating table and the abdomen.
"""

from __future__ import annotations

import argparse
import shutil
import socket
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

import twin
from twin import assets, spatial
from twin.api import tool_frame
from twin.spatial import Array
from twin.stage.read import read_motion, read_stage

CHROMIUM = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = (
    "--headless --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --disable-dev-shm-usage "
    "--disable-background-networking --disable-extensions --no-first-run --mute-audio --hide-scrollbars"
).split()
OVERSAMPLING = 2
CREASE = np.radians(35)  # edges sharper than this stay edges
SKY, GROUND = (250, 251, 253), (214, 220, 228)
ORANGE, TEAL = (255, 120, 20), (70, 150, 160)
FLOOR = -0.42  # underside of the feet


@dataclass(frozen=True)
class Shot:
    """A picture: where in which protocol, and from where."""

    name: str
    label: str
    protocol: str
    waypoint: str
    rcm: str  # the waypoint whose position is the trocar
    eye: tuple[float, float, float] = (2.15, -1.02, 0.78)
    target: tuple[float, float, float] = (0.15, 0.32, 0.12)
    size: tuple[int, int] = (1200, 1000)
    patient: bool = False


SHOTS = (
    Shot("C", "C", "table2", "c", "b"),
    Shot("B", "B", "table2", "b", "b"),
    Shot("I", "I", "table2", "i", "b"),
    Shot("T", "T′", "table2", "t_prime", "b"),
    Shot("lowered", "", "lowered_patient", "far", "port", (2.3, -1.15, 0.85), (0.2, 0.31, 0.1), (1600, 1000), True),
)


def stand(robot: twin.Robot, shot: Shot) -> tuple[dict[str, Array], Array, Array, Array]:
    """Return the link poses at the waypoint, the trocar, and a point and direction (to the tip) of the shaft."""
    assert robot.files is not None
    stage = robot.files.usd / f"{robot.name}_{shot.protocol}.usda"
    mechanism, (times, poses) = read_stage(stage), read_motion(stage)
    protocol = robot.protocol(shot.protocol)
    T_tool_moved = tool_frame(mechanism, protocol.frame)
    tool = mechanism.frame(mechanism.tool)
    Ts_tool = poses[tool.body] @ tool.T_body_frame
    Ts_moved = Ts_tool @ T_tool_moved
    way, rcm = protocol.waypoints[shot.waypoint], protocol.waypoints[shot.rcm].position
    psi, theta, phi = way.angles
    R = spatial.rotation_z(psi) @ spatial.exp_so3([0, theta, 0]) @ spatial.exp_so3([phi, 0, 0])
    axis = T_tool_moved[:3, :3] @ protocol.shaft_axis
    p = way.position if way.position is not None else rcm + way.depth * R @ axis
    miss = np.linalg.norm(Ts_moved[:, :3, 3] - p, axis=1)
    turn = spatial.rotation_angle(R.T @ Ts_tool[:, :3, :3])
    k = int(np.argmin(miss + 0.1 * turn))
    print(f"{shot.name}: t = {times[k]:.3f} s, {1e3 * miss[k]:.4f} mm and {np.degrees(turn[k]):.4f} deg off the waypoint")
    if miss[k] > 1e-4 or turn[k] > np.radians(0.1):
        raise SystemExit(f"{stage} never stands at {shot.waypoint}: rebuild it with `twin build {robot.name}`")
    return {name: T[k] for name, T in poses.items()}, rcm, Ts_moved[k, :3, 3], Ts_tool[k, :3, :3] @ axis


def srgb(linear: tuple[float, ...]) -> tuple[int, ...]:
    """Return linear 0..1 as sRGB 0..255."""
    c = np.asarray(linear[:3])
    c = np.where(c <= 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055)
    return tuple(int(v) for v in np.round(255 * c))


def add_robot(server: viser.ViserServer, mechanism) -> dict[str, viser.FrameHandle]:
    """Show the meshes of each body, merged by colour; return one frame for each body."""
    frames = {}
    for body in mechanism.bodies:
        frames[body.name] = server.scene.add_frame(f"/{body.name}", show_axes=False)
        by_color: dict[tuple[float, ...], list[trimesh.Trimesh]] = {}
        for mesh in body.meshes:
            solid = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
            solid = trimesh.graph.smooth_shade(solid, angle=CREASE, facet_minarea=None)
            by_color.setdefault(mesh.color_rgba, []).append(solid)
        for i, (color, solids) in enumerate(by_color.items()):
            all_ = trimesh.util.concatenate(solids)
            server.scene.add_mesh_simple(f"/{body.name}/m{i}", all_.vertices, all_.faces, color=srgb(color))
    return frames


def add_surroundings(server: viser.ViserServer, robot: twin.Robot, shot: Shot, rcm: Array, p: Array, n: Array) -> None:
    """Show floor, lights, trocar, shaft axis and, if asked for, table and abdomen."""
    scene = server.scene
    scene.configure_default_lights(False)
    scene.configure_environment_map("studio", environment_intensity=0.45)
    scene.add_light_directional("/key", intensity=2.2, position=(1.2, -0.7, 2.2), cast_shadow=True)
    scene.add_light_directional("/fill", intensity=0.7, position=(0.6, 2.0, 0.6))
    scene.add_grid(
        "/floor", 6, 6, cell_size=0.1, section_size=0.5, cell_color=(205, 211, 219), section_color=(186, 194, 204),
        position=(0.2, 0.3, FLOOR), fade_distance=2.4, fade_from="origin", shadow_opacity=0.35,
    )  # fmt: skip
    scene.add_icosphere("/rcm", 0.009, ORANGE, position=tuple(rcm), cast_shadow=False)
    ends = np.array([[rcm - 0.36 * n, rcm + 0.16 * n]])
    scene.add_line_segments("/shaft", ends, ORANGE, thickness=0.0025)
    if shot.patient:
        x, y, z = rcm
        scene.add_box("/table", (0.16, 0.16, 0.16), dimensions=(0.50, 1.3, 0.03), position=(x, y, z - 0.225))
        body = trimesh.creation.icosphere(4, 1.0)
        body = body.slice_plane([0, 0, 0], [0, 0, 1])
        body.apply_scale((0.20, 0.30, 0.20))
        scene.add_mesh_simple(
            "/abdomen", body.vertices, body.faces, color=(232, 190, 168), opacity=0.4,
            position=(x, y, z - 0.2), cast_shadow=False,
        )  # fmt: skip


def look_at(eye: Array, target: Array) -> tuple[Array, Array]:
    """Return wxyz and position of a camera: z forward, y down, no roll about world z."""
    z = (target - eye) / np.linalg.norm(target - eye)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return spatial.quat_from_matrix_wxyz(np.column_stack([x, np.cross(z, x), z])), eye


@contextmanager
def browser(url: str, size: tuple[int, int]) -> Iterator[None]:
    """Keep a headless Chromium open at a page."""
    program = next((p for name in CHROMIUM if (p := shutil.which(name))), None)
    if program is None:
        raise SystemExit(f"no Chromium on the PATH (looked for {', '.join(CHROMIUM)}); apt-get install chromium")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        window = f"--window-size={size[0]},{size[1]}"
        command = [program, *FLAGS, window, f"--user-data-dir={profile}", "--remote-debugging-port=0", url]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            yield
        finally:
            process.terminate()
            process.wait(20)


def render(robot: twin.Robot, shot: Shot) -> Image.Image:
    """Return the picture of one shot."""
    poses, rcm, p, n = stand(robot, shot)
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    server = viser.ViserServer(host="127.0.0.1", port=port, verbose=False)
    assert robot.files is not None
    mechanism = read_stage(robot.files.usd / f"{robot.name}_{shot.protocol}.usda")
    try:
        for name, frame in add_robot(server, mechanism).items():
            frame.wxyz, frame.position = spatial.quat_from_matrix_wxyz(poses[name][:3, :3]), poses[name][:3, 3]
        add_surroundings(server, robot, shot, rcm, p, n)
        width, height = (OVERSAMPLING * v for v in shot.size)
        wxyz, eye = look_at(np.array(shot.eye), np.array(shot.target))
        with browser(f"http://127.0.0.1:{port}", (width + 100, height + 200)):
            deadline = time.monotonic() + 60
            while not server.get_clients():
                if time.monotonic() > deadline:
                    raise SystemExit("Chromium did not connect within 60 s")
                time.sleep(0.2)
            client = next(iter(server.get_clients().values()))
            for _ in range(2):  # meshes and light map arrive while the first is drawn
                time.sleep(4)
                rgba = client.get_render(
                    height, width, wxyz=wxyz, position=eye, fov=np.radians(28), transport_format="png", timeout=180
                )
    finally:
        server.stop()
    shade = np.linspace(0, 1, height)[:, None, None] ** 1.3
    back = Image.fromarray(np.broadcast_to((1 - shade) * SKY + shade * GROUND, (height, width, 3)).astype(np.uint8))
    back.paste(front := Image.fromarray(rgba), mask=front.getchannel("A"))
    return back.resize(shot.size, Image.Resampling.LANCZOS)


def main() -> None:
    """Draw the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=assets.data_folder() / "docs" / "pictures")
    parser.add_argument("--only", nargs="+", choices=[s.name for s in SHOTS], help="default: all")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    robot = twin.load("sils")
    for shot in SHOTS:
        if args.only and shot.name not in args.only:
            continue
        image = render(robot, shot)
        image.save(args.out / f"sils_{shot.name}.png", optimize=True)


if __name__ == "__main__":
    main()
