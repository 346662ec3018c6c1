"""Helpers for tests of the page of `twin serve`: server, browser, emulated headset, rays and pixels."""

from __future__ import annotations

import io
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from made.ports import free_port
from twin.core import spatial
from witness import environments

ROOT = Path(__file__).parents[2]
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage",
         "--disable-gpu-compositing"]  # fmt: skip
"""Of a browser without a graphics card. It composes its pages without the one that it emulates, which takes longer."""

WAIT = 180.0
"""Time limit in s of a wait, for a busy machine without a graphics card."""

FLOAT32 = 2e-6
"""Largest error of a pose entry after rounding to float32, for a robot of 2 m at a distance of some metres."""


def until(condition, what, seconds=WAIT):
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, f"{what}: not within {seconds:g} s"
        time.sleep(0.05)
    return found


def npm_environment(name):
    """Return the folder with the packages of a lock file.

    If it is missing, skip the test with a message, or fail if the environment variable TWIN_WITNESS_REQUIRED is set.
    """
    try:
        return environments.environment(name).folder
    except environments.NotThereError as error:
        if os.environ.get("TWIN_WITNESS_REQUIRED"):
            pytest.fail(str(error), pytrace=False)
        pytest.skip(str(error))


def bundled_emulator(folder):
    """Bundle the emulator of tests/witness/emulator to one file in a folder, and return this file."""
    packages = npm_environment("emulator")
    for name in ("emulator.mjs", "build.mjs"):
        shutil.copy(ROOT / "tests/witness/emulator" / name, folder)
    (folder / "node_modules").symlink_to(packages / "node_modules")
    out = folder / "emulator.js"
    node = environments.node()
    done = subprocess.run([node, "build.mjs", out], cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return out


def chromium():
    """Yield a Chromium browser; used as the body of a fixture."""
    from playwright.sync_api import sync_playwright

    program = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chromium-browser")
    if program is None:
        pytest.skip("NO CHROMIUM: the page is not tested. Install it (Debian: apt-get install chromium)")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=as_a_user(program, Path(folder)), args=FLAGS)
        yield browser
        browser.close()


def as_a_user(program, folder):
    """Return a program that starts `program` without root's right to raise its priority.

    With this right, Chromium draws at priority -8. Without a graphics card, it then uses both processors, and none is
    left for the server.
    """
    if os.geteuid() != 0 or (setpriv := shutil.which("setpriv")) is None:
        return program
    start = folder / "start"
    start.write_text(f'#!/bin/sh\nexec {setpriv} --bounding-set=-sys_nice -- {program} "$@"\n')
    start.chmod(0o755)
    return str(start)


class Serving:
    """A process of `twin serve`, started from a command line, or of another module with a robot and --port."""

    def __init__(self, robot, port=None, *more, command=("twin", "serve", "--no-browser")):
        self.robot, self.port, self.more, self.command = robot, port or free_port(), more, command
        self.process = None
        self.start()

    @property
    def url(self):
        return f"http://127.0.0.1:{self.port}/"

    def start(self):
        command = [sys.executable, "-m", *self.command, self.robot, "--port", self.port, *self.more]
        env = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")])}
        self.process = subprocess.Popen([str(c) for c in command], env=env, stdout=subprocess.DEVNULL)

        def listens():
            assert self.process is not None
            assert self.process.poll() is None, "the server has ended"
            with socket.socket() as s:
                return s.connect_ex(("127.0.0.1", self.port)) == 0

        until(listens, "the server listens")

    def stop(self):
        if self.process is not None:
            self.process.terminate()
            self.process.wait(60)
            self.process = None


BLIND = """
globalThis.blind = %s;
const kinds = WebGL2RenderingContext.prototype;
for (const name of ['clear', 'drawArrays', 'drawArraysInstanced', 'drawElements', 'drawElementsInstanced']) {
  const draw = kinds[name];
  kinds[name] = function (...what) {
    if (!globalThis.blind) draw.apply(this, what);
  };
}
"""
"""Script of a page whose graphics draw nothing while `blind` is true."""


class Page:
    """One page, and the state that it provides as `window.twin`; `errors` lists its error messages.

    With `draws` False it is opened as `Page.draws` leaves it: shadows and other pictures that are drawn only once are
    never drawn. A screen with a small `scale` has fewer pixels than its `size`, which its fingers and mouse count.
    """

    def __init__(self, browser, url, size=(1280, 800), scripts=(), draws=True, scale=1.0):
        self.errors = []
        self.page = browser.new_page(viewport={"width": size[0], "height": size[1]}, device_scale_factor=scale)
        self.page.set_default_timeout(1000 * WAIT)
        self.page.on("pageerror", lambda e: self.errors.append(str(e)))
        self.page.on("console", lambda m: self.errors.append(m.text) if m.type == "error" else None)
        for script in (BLIND % str(not draws).lower(), *scripts):
            kind = "path" if isinstance(script, Path) else "script"
            self.page.add_init_script(**{kind: script})
        self.page.goto(url)
        self.until("window.twin?.app.firstPicture > 0", "the robot's first picture")
        self.until("twin.app.model.frame !== null", "the first frame")
        if not draws:
            self.draws(False)

    def __call__(self, expression):
        return self.page.evaluate(expression)

    def until(self, expression, what, seconds=WAIT):
        # playwright's own wait uses eval, which the page's policy forbids
        try:
            return until(lambda: self.page.evaluate(expression), what, seconds)
        except AssertionError as error:
            raise AssertionError(f"{error}; the page says: {self.page.inner_text('body')}") from None

    def draws(self, on):
        """Let the page draw, or only update its matrices, because drawing is slow without a graphics card.

        An emulated headset clears the canvas before each picture and draws its room; both would be drawing too.
        """
        self(
            """((on) => {
              const still = (scene, camera) => {
                scene.updateMatrixWorld();
                if (camera.parent === null) camera.updateMatrixWorld();
                if (renderer.xr.enabled && renderer.xr.isPresenting) renderer.xr.updateCamera(camera);
              };
              const { renderer } = twin.app.world;
              for (const each of [renderer, globalThis.device?.sem?.renderer]) {
                if (each === undefined) continue;
                each.drawing ??= each.render;
                each.render = on ? each.drawing : still;
              }
              globalThis.blind = !on;
            })"""
            f"({str(on).lower()})"
        )

    @contextmanager
    def sized(self, width, height):
        """Change the size of the window in px; the old size is restored at the end of the block."""
        before = self.page.viewport_size
        self.page.set_viewport_size({"width": width, "height": height})
        try:
            yield
        finally:
            self.page.set_viewport_size(before)

    def close(self):
        self.page.close()

    def id(self, name):
        return self.page.locator(f"[data-id='{name}']")

    def tab(self, name):
        self.page.get_by_role("tab", name=name).click()

    def image(self):
        return np.asarray(Image.open(io.BytesIO(self.page.screenshot())).convert("RGB")).astype(int)

    def state(self):
        """Return (q (n,), link poses, root, poses, flags), all of one picture.

        The link poses (4, 4) are those of the drawn nodes in the robot's world, by name; `root` (4, 4) is the pose of
        this world in the scene; `poses` (4, 4) are those of the streamed frame, by name.
        """
        got = self(
            "(() => ({q: [...twin.app.model.frame.q], flags: twin.app.model.frame.flags, links: twin.links(),"
            " root: twin.root(), poses: twin.poses()}))()"
        )
        root = _matrix(got["root"])
        links = {n: np.linalg.solve(root, _matrix(m)) for n, m in got["links"].items()}
        poses = {n: _pose(p) for n, p in got["poses"].items()}
        return np.array(got["q"]), links, root, poses, got["flags"]

    def pixel(self, p_scene):
        """Return the pixel (x, y) of the page at which a point (3,) of the scene is drawn."""
        c = self("twin.camera()")
        clip = _matrix(c["projection"]) @ _matrix(c["view"]) @ np.append(p_scene, 1.0)
        x, y = clip[:2] / clip[3]
        w, h = self.page.viewport_size["width"], self.page.viewport_size["height"]
        return np.array([w * (1 + x) / 2, h * (1 - y) / 2])

    def to_scene(self, p_robot):
        return (_matrix(self("twin.root()")) @ np.append(p_robot, 1.0))[:3]

    def tool(self):
        """Return the tool's pose (4, 4) in the robot's world, from the poses of the drawn links."""
        info = self("({link: twin.app.model.info.tool.link, T: twin.app.model.info.tool.T_link_tool})")
        return self.state()[1][info["link"]] @ _pose(info["T"])

    def pixel_of_link(self, link):
        """Return a pixel (x, y) of the page at which the mouse would grab a link."""
        got = self(
            f"""(() => {{
              const app = twin.app, l = app.robot.links.get('{link}'), at = app.mouse.at;
              for (const p of l.points) {{
                const v = p.clone().applyMatrix4(l.node.matrixWorld).project(app.world.camera);
                at.set(v.x, v.y);
                if (app.mouse.pick()?.link === '{link}') return [v.x, v.y];
              }}
              return null;
            }})()"""
        )
        assert got is not None, f"{link} is nowhere to be seen"
        size = self.page.viewport_size
        return np.array([size["width"] * (1 + got[0]) / 2, size["height"] * (1 - got[1]) / 2])

    def drag(self, start, end, steps=10, release=True):
        mouse = self.page.mouse
        mouse.move(*start)
        mouse.down()
        self.until("twin.app.grab.held?.granted", "the grab")
        for s in np.linspace(0, 1, steps + 1)[1:]:
            mouse.move(*(np.asarray(start) + s * (np.asarray(end) - start)))
            time.sleep(0.05)
        if release:
            mouse.up()

    def settled(self):
        """Wait until the robot is at rest."""
        last, same = None, 0
        end = time.monotonic() + WAIT
        while same < 4:  # the server may be slow to begin
            assert time.monotonic() < end, "the robot does not come to rest"
            frames, q = self("[twin.app.line.frames, [...twin.app.model.frame.q]]")
            same = same + 1 if q == last else 0
            last = q
            time.sleep(0.4)
            self.until(f"twin.app.line.frames > {frames + 3}", "newer frames")

    # -- a device ----------------------------------------------------------------------------------------

    def enter(self, button="enter"):
        self.id(button).click()
        self.until("twin.app.xr.frames > 3", "pictures of the session")

    def aim(self, target, side="right", kind="controllers", start=None):
        """Point a controller or hand at the point `target` of the scene, from `start` or (None) from its position."""
        at = np.array(self(f"device.{kind}.{side}.position.array ? [...device.{kind}.{side}.position.array] : "
                           f"[device.{kind}.{side}.position.x, device.{kind}.{side}.position.y, "
                           f"device.{kind}.{side}.position.z]") if start is None else start)  # fmt: skip
        x, y, z, w = looking(np.asarray(target) - at)
        self(f"device.{kind}.{side}.position.set({at[0]}, {at[1]}, {at[2]}),"
             f"device.{kind}.{side}.quaternion.set({x}, {y}, {z}, {w})")  # fmt: skip
        self.pictures(3)
        return at

    def pictures(self, n):
        """Wait until the session has drawn n pictures."""
        first = self("twin.app.xr.frames")
        self.until(f"twin.app.xr.frames >= {first + n}", f"{n} pictures")

    def select(self, on, side="right", kind="controllers"):
        value = 1 if on else 0
        how = f"updateButtonValue('trigger', {value})" if kind == "controllers" else f"updatePinchValue({value})"
        self(f"device.{kind}.{side}.{how}")
        self.pictures(3)

    def press(self, control, side="right", kind="controllers"):
        """Press a control of the floating panel with the ray of a controller or hand."""
        where = self(f"(() => {{const p = twin.app.xrPanel, uv = p.whereIs('{control}');"
                     f" return uv ? p.pointAt(uv).toArray() : null}})()")  # fmt: skip
        assert where is not None, f"{control} is not in sight on the panel"
        self.aim(where, side, kind)
        self.select(True, side, kind)
        self.select(False, side, kind)


def looking(direction):
    """Return the quaternion xyzw that rotates -z to a direction (3,), with x horizontal."""
    z = -np.asarray(direction) / np.linalg.norm(direction)
    x = np.cross([0, 1, 0], z)
    x /= np.linalg.norm(x)
    return np.roll(spatial.quat_from_matrix_wxyz(np.column_stack([x, np.cross(z, x), z])), -1)


TILE = 24
"""Size of a tile in pixels."""


def probes(page, mechanism, rng, each=14):
    """Compare the colours of pixels with the links that they must show; return (correct, tested, list of misses).

    Links are painted in flat colours. The link that a pixel must show is computed in this file, by rays through the CAD
    meshes at the poses of the frame. Pixels at the edge of a link are not tested, because their colours are mixed. No
    pixel is tested twice.
    """
    colors = {n: np.array([int(c[i : i + 2], 16) for i in (0, 2, 4)]) for n, c in page("twin.paint(true)").items()}
    time.sleep(1.0)
    page.until("!twin.app.world.dirty || twin.app.xr.presenting", "a picture")
    _, _, root, poses, _ = page.state()
    c = page("twin.camera()")
    image = page.image()
    page("twin.paint(false)")
    clip = _matrix(c["projection"]) @ _matrix(c["view"]) @ root
    names, corners = [], []
    for body in mechanism.bodies:
        for mesh in body.meshes:
            v = np.c_[mesh.vertices, np.ones(len(mesh.vertices))] @ (clip @ poses[body.name]).T
            corners.append(v[mesh.triangles])
            names += [body.name] * len(mesh.triangles)
    t, names = np.concatenate(corners), np.array(names)
    t, names = t[(t[:, :, 3] > 1e-3).all(axis=1)], names[(t[:, :, 3] > 1e-3).all(axis=1)]
    h, w = image.shape[:2]
    xy = np.stack([w * (1 + t[..., 0] / t[..., 3]) / 2, h * (1 - t[..., 1] / t[..., 3]) / 2], -1)
    depth = t[..., 2] / t[..., 3]
    low, high = xy.min(axis=1), xy.max(axis=1)
    inside = ((high >= 0) & (low <= [w, h])).all(axis=1)
    xy, depth, names, low, high = xy[inside], depth[inside], names[inside], low[inside], high[inside]

    @cache
    def of_tile(column, row):
        """Return the triangles whose boxes meet a square tile of the picture."""
        corner = TILE * np.array([column, row])
        return np.flatnonzero(((low <= corner + TILE) & (corner <= high)).all(axis=1))

    def seen(p):
        k = of_tile(*(p // TILE).astype(int))
        k = k[((low[k] <= p) & (p <= high[k])).all(axis=1)]
        if not len(k):
            return None
        a, b, c3 = xy[k, 0], xy[k, 1] - xy[k, 0], xy[k, 2] - xy[k, 0]
        det = b[:, 0] * c3[:, 1] - b[:, 1] * c3[:, 0]
        ok = np.abs(det) > 1e-12
        d = p - a
        with np.errstate(divide="ignore", invalid="ignore"):
            u = (d[:, 0] * c3[:, 1] - d[:, 1] * c3[:, 0]) / det
            s = (b[:, 0] * d[:, 1] - b[:, 1] * d[:, 0]) / det
        hit = ok & (u >= 0) & (s >= 0) & (u + s <= 1)
        if not hit.any():
            return None
        k, u, s = k[hit], u[hit], s[hit]
        z = depth[k, 0] + u * (depth[k, 1] - depth[k, 0]) + s * (depth[k, 2] - depth[k, 0])
        return names[k[np.argmin(z)]]

    right, total, missed = 0, 0, []
    cross, square = [[1, 0], [-1, 0], [0, 1], [0, -1]], [[1, 1], [1, -1], [-1, 1], [-1, -1]]
    around = np.array([[0, 0], *np.multiply(0.4, cross + square), *np.multiply(1.6, cross)])
    for name in colors:
        pixels = np.unique(np.floor(xy[names == name].mean(axis=1)) + 0.5, axis=0)
        found = 0
        for p in rng.permutation(pixels)[: 20 * each]:
            if found == each or not ((p > 3).all() and p[0] < w - 3 and p[1] < h - 3):
                continue
            if any(seen(p + offset) != name for offset in around):
                continue
            found, total = found + 1, total + 1
            pixel = image[int(p[1]), int(p[0])]
            if np.abs(pixel - colors[name]).max() <= 10:
                right += 1
            else:
                missed.append((name, p.tolist(), pixel.tolist(), colors[name].tolist()))
    return right, total, missed


@contextmanager
def shown(browser, url, **options):
    """Yield a page; at the end, check that it reported no errors, and close it."""
    page = Page(browser, url, **options)
    try:
        yield page
        assert page.errors == []
    finally:
        page.close()


def ready(page, robot):
    """Wait for the plan of the protocol, and until the robot is at rest at home."""
    page.until("twin.app.model.state.duration > 0", "the plan")
    page("twin.app.ask('play', {on: false}); twin.app.ask('posture', {name: 'home'})")
    home = robot.mechanism.posture("home")

    def there():
        # a hand of the previous page may still hold the robot
        page("twin.app.model.state.phase === null || twin.app.ask('posture', {name: 'home'})")
        return np.allclose(page("[...twin.app.model.frame.q]"), home, atol=1e-6)

    until(there, "the robot goes home")
    page.settled()


def agrees(page, robot):
    """Check that drawn links, streamed poses and reference model agree; return q (n,)."""
    q, links, _, poses, _ = page.state()
    truth = robot.reference().solve(q).link_poses
    for name, T in links.items():
        np.testing.assert_allclose(T, poses[name], atol=FLOAT32, err_msg=name)
        np.testing.assert_allclose(T, truth[name], atol=1e-5, err_msg=name)  # q was also rounded to float32
    return q


def _matrix(numbers):
    return np.array(numbers, float).reshape(4, 4).T


def _pose(seven):
    v = np.array(seven, float)
    return spatial.pose(spatial.matrix_from_quat_wxyz(np.roll(v[3:] / np.linalg.norm(v[3:]), 1)), v[:3])
