"""Three tasks of a newcomer, as the README says them: see the verdict, move the robot, export it. Prints their times.

    python tests/benchmarks/newcomer.py [--keep FOLDER]

The README's commands are typed in a fresh clone, without .venv, with an empty home: every package is downloaded. When
the page of `twin view` has its robot, the tool is dragged as a browser drags it, and a link must follow. The first time
includes the set-up (`make demo`). Not a test: times depend on the network. Exit code 1 if a task fails, or if all of
them take five minutes or more.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import viser
import zstandard
from websockets.sync.client import ClientConnection, connect

ROOT = Path(__file__).resolve().parents[2]
LIMIT = 300.0
"""Seconds for all tasks together."""

PATIENCE = 120.0
"""Seconds until a page has its robot."""

ADDRESS = re.compile(r"http://127[.]0[.]0[.]1:[0-9]+")
DRAG = np.array([0.0, 0.0, 0.02])
"""By how much the tool is dragged, in m."""


def environment_of(home: Path) -> dict[str, str]:
    """Return the environment of a new user: programs of the system, and settings of the network."""
    kept = {}
    for name, value in os.environ.items():
        if name in ("LANG", "TERM") or name.lower().endswith("_proxy") or name.startswith(("PIP_", "SSL_")):
            kept[name] = value
    programs = []
    for folder in os.environ["PATH"].split(os.pathsep):
        if not Path(folder).is_relative_to(Path.home()) and not Path(folder).is_relative_to(ROOT):
            programs.append(folder)
    # a browser that shows nothing: the script looks at the page itself
    return kept | {"HOME": str(home), "PATH": os.pathsep.join(programs), "BROWSER": "true"}


CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [1.0, 1.0, 1.0],
    "fov": 0.8,
    "near": 0.01,
    "far": 100.0,
    "image_height": 600,
    "image_width": 800,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}
"""What a browser sends first; the server then takes its drags."""


class Newcomer:
    """Who has a clone and its README, and types what it says."""

    def __init__(self, folder: Path) -> None:
        """Clone the repository into a folder, beside an empty home."""
        self.clone = folder / "twin"
        home = folder / "home"
        home.mkdir()
        subprocess.run(["git", "clone", "--quiet", ROOT, self.clone], check=True)
        self.environment = environment_of(home)
        text = (self.clone / "README.md").read_text(encoding="utf-8")
        self.lines: list[str] = []
        for block in re.findall(r"^```console\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
            for line in block.splitlines():
                self.lines.append(line.partition(" # ")[0].strip())
        self.active = ""

    def line(self, beginning: str) -> str:
        """Return the one command of the README that begins so.

        Raises:
            SystemExit: the README has none, or several.
        """
        found = [line for line in self.lines if line.startswith(beginning)]
        if len(found) != 1:
            raise SystemExit(f"README.md has {len(found)} commands that begin with '{beginning}'")
        return found[0]

    def type(self, command: str, code: int = 0) -> str:
        """Run a command in the folder of the clone, and return what it prints.

        Raises:
            SystemExit: another exit code.
        """
        shell = ["bash", "-c", f"{self.active}{command}"]
        done = subprocess.run(shell, cwd=self.clone, env=self.environment, capture_output=True, text=True, check=False)
        said = done.stdout + done.stderr
        if done.returncode != code:
            raise SystemExit(f"{command}: exit code {done.returncode}, not {code}\n{said[-3000:]}")
        return said

    def see_the_verdict(self) -> None:
        """Set everything up, and read that equation (1) is wrong, and its fix."""
        begin = time.monotonic()
        said = self.type(self.line("make demo"))
        print(f"  set-up with {self.line('make demo')}: {time.monotonic() - begin:.0f} s")
        if "AGREE" not in said:
            raise SystemExit(f"make demo shows no verdict:\n{said[-3000:]}")
        self.active = self.line(". ") + " && "
        said = self.type(self.line("twin validate"), code=1)
        for part in ("DISAGREE", "c_phi", "3.04"):
            if part not in said:
                raise SystemExit(f"the verdict does not say {part}:\n{said[-3000:]}")

    def move_the_robot(self) -> None:
        """Serve the page, drag the tool, and see the links move."""
        command = self.line("twin view")
        shell = ["bash", "-c", f"{self.active}exec {command}"]
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        with subprocess.Popen(shell, cwd=self.clone, env=self.environment, text=True, **pipes) as process:
            try:
                assert process.stdout is not None
                said = ""
                while (address := ADDRESS.search(said)) is None:
                    more = process.stdout.readline()
                    if not more:
                        raise SystemExit(f"{command} ended: {said}")
                    said += more
                with opened(address[0]) as page:
                    drag_the_tool(page)
                process.send_signal(signal.SIGINT)  # as the page that opens it says: Ctrl-C
                said += process.communicate(timeout=60)[0]
            finally:
                process.kill()
        if process.returncode:
            raise SystemExit(f"{command}: exit code {process.returncode}\n{said}")

    def export(self) -> None:
        """Export a file for a headset, and find it where the command says."""
        said = self.type(self.line("twin export"))
        made = sorted((self.clone / "twin-out").rglob("*.glb"))
        if not made or "PASS" not in said:
            raise SystemExit(f"no GLB, or no PASS:\n{said[-3000:]}")


def opened(address: str) -> ClientConnection:
    """Return a connection to the page's server, as a browser has it."""
    protocol = f"viser-v{viser.__version__}"
    url = address.replace("http", "ws", 1)
    return connect(url, subprotocols=[protocol], compression=None, max_size=None, proxy=None)  # pyright: ignore


def messages(page: ClientConnection) -> list[dict[str, Any]]:
    """Return the messages of the next frame of a page."""
    data = page.recv(timeout=PATIENCE)
    assert isinstance(data, bytes)
    packed = data[16 : 16 + int.from_bytes(data[8:16], "little")]
    return msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(packed))["messages"]


def until(page: ClientConnection, found: Callable[[dict[str, Any]], bool], what: str) -> None:
    """Read messages until one is found.

    Raises:
        SystemExit: none was found in time.
    """
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        for message in messages(page):
            if found(message):
                return
    raise SystemExit(f"the page shows no {what} within {PATIENCE:g} s")


def drag_the_tool(page: ClientConnection) -> None:
    """Drag the tool, and wait until a link is elsewhere."""
    places: dict[str, np.ndarray] = {}
    turns: dict[str, np.ndarray] = {}
    meshes: set[str] = set()

    def is_complete(message: dict[str, Any]) -> bool:
        name = message.get("name", "")
        if message["type"] == "SetPositionMessage":
            places[name] = np.array(message["position"])
        if message["type"] == "SetOrientationMessage":
            turns[name] = np.array(message["wxyz"])
        if "Mesh" in message["type"] or "Glb" in message["type"]:
            meshes.add(name)
        return bool(meshes) and "/tool" in places and "/tool" in turns

    until(page, is_complete, "robot")
    goal = places["/tool"] + DRAG
    update = {"type": "TransformControlsUpdateMessage", "name": "/tool"}
    place = {"position": goal.tolist(), "wxyz": turns["/tool"].tolist()}
    page.send(msgspec.msgpack.encode(CAMERA))
    page.send(msgspec.msgpack.encode({"type": "TransformControlsDragStartMessage", "name": "/tool"}))
    page.send(msgspec.msgpack.encode(update | place))

    def has_moved(message: dict[str, Any]) -> bool:
        name = message.get("name", "")
        is_link = name.count("/") == 2 and name in places  # /robot/link
        if message["type"] != "SetPositionMessage" or not is_link:
            return False
        distance = float(np.linalg.norm(np.array(message["position"]) - places[name]))
        return distance > 0.5 * float(np.linalg.norm(DRAG))

    until(page, has_moved, "link that follows the tool")


def main() -> int:
    """Do the three tasks, and return 0 if all of them take less than five minutes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, help="an empty folder for clone and home, which stays")
    args = parser.parse_args()
    times: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        person = Newcomer(folder.resolve())
        tasks = {
            "see the verdict": person.see_the_verdict,
            "move the robot": person.move_the_robot,
            "export to GLB": person.export,
        }
        for name, task in tasks.items():
            begin = time.monotonic()
            task()
            times[name] = time.monotonic() - begin
            print(f"{name}: {times[name]:.0f} s", flush=True)
    total = sum(times.values())
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    waiting, processors = os.getloadavg()[1], os.cpu_count()
    print(f"total: {total:.0f} s (limit {LIMIT:.0f} s), with a load of {waiting:.1f} on {processors} processors")
    print(f"processor time: {used.ru_utime + used.ru_stime:.0f} s")
    print(json.dumps({name: round(seconds, 1) for name, seconds in times.items()}))
    return 0 if total < LIMIT else 1


if __name__ == "__main__":
    sys.exit(main())
