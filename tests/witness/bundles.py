"""What the witnesses read, and what it must show.

Each robot is exported once, with the protocols of `made.motions` in every format, and its truth is worked out beside
it: poses of every link in double precision by the reference model, at times that the tracks name as keys. Truth is
planned here from the protocol and never looks at what was exported, but for these times.

Both are kept in twin-out/witness/<robot>-<hash of the sources> for all test processes, and for the next run.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from made.motions import motions
from twin.core.assets import files
from twin.exchange.formats import export_formats

ROOT = Path(__file__).parents[2]
KEPT = ROOT / "twin-out/witness"
FORMATS = tuple(format.name for format in export_formats() if format.variants)
FRAMES = 24
POSITION = 1e-6
"""m that a foreign program may be off: single precision at one metre is 6e-8."""
ROTATION = 1e-4
"""rad, likewise."""


@dataclass(frozen=True)
class Motion:
    """Truth of one protocol: `times` (k,) s, `links` T_world_link (k, 4, 4), `duration` s."""

    times: np.ndarray
    links: Mapping[str, np.ndarray]
    duration: float


@dataclass(frozen=True)
class Case:
    """One robot: the exported `folder`, and the truth by protocol."""

    robot: str
    folder: Path
    motions: Mapping[str, Motion]

    @property
    def glb(self) -> Path:
        return self.folder / f"{self.robot}.glb"

    def usdz(self, protocol: str) -> Path:
        """The motion of the default protocol is in the file without its name."""
        named = self.folder / f"{self.robot}_{protocol}_ar.usdz"
        return named if named.is_file() else self.folder / f"{self.robot}_ar.usdz"

    def usd(self, protocol: str = "") -> Path:
        return self.folder / "usd" / f"{self.robot}{'_' if protocol else ''}{protocol}.usda"

    def job(self, path: Path, *kinds: str) -> Path:
        """Write the job of a reader (every protocol in each kind of glb, usdz, usd) to a path and return it."""
        tasks = []
        for kind in kinds:
            for protocol, motion in self.motions.items():
                file = self.glb if kind == "glb" else getattr(self, kind)(protocol)
                tasks.append(task(f"{kind} {protocol}", file, motion, clip=protocol if kind == "glb" else ""))
        path.write_text(json.dumps(tasks), encoding="utf-8")
        return path


def task(id_: str, file: Path, motion: Motion, clip: str = "") -> dict[str, Any]:
    """Return one entry of a job: what to open, which clip, at which times, and what to look for."""
    return {"id": id_, "path": str(file), "clip": clip, "times": motion.times.tolist(), "links": list(motion.links)}


@dataclass(frozen=True)
class Worst:
    """Worst errors of a reader in m and rad with link and time, and the links that it did not show, or showed twice."""

    position: float
    position_at: tuple[str, float]
    rotation: float
    rotation_at: tuple[str, float]
    missing: tuple[str, ...]
    twice: tuple[str, ...]

    @property
    def good(self) -> bool:
        return not self.missing and not self.twice and self.position <= POSITION and self.rotation <= ROTATION


def compare(found: Mapping[str, Any], motion: Motion) -> Worst:
    """Return how far what a reader shows is from the truth.

    Rotation is the angle whose chord the nine numbers are apart: scale, shear and mirrors count as well.
    """
    shown = found["links"]
    missing = tuple(name for name in motion.links if name not in shown)
    position, rotation = (0.0, ("", 0.0)), (0.0, ("", 0.0))
    for name, truth in motion.links.items():
        if name in missing:
            continue
        Ts = np.array(shown[name], float).reshape(-1, 4, 4)  # what is no number becomes NaN, and is infinitely wrong
        assert Ts.shape == truth.shape, f"{name}: {len(Ts)} poses at {len(truth)} times"
        off = np.linalg.norm((Ts - truth)[:, :3, 3], axis=1)
        chord = np.linalg.norm((Ts - truth)[:, :3, :3], axis=(1, 2)) / np.sqrt(8)
        for errors, is_turn in ((off, False), (2 * np.arcsin(np.minimum(chord, 1.0)), True)):
            errors = np.where(np.isnan(errors), np.inf, errors)
            k = int(np.argmax(errors))
            now = (float(errors[k]), (name, float(motion.times[k])))
            if is_turn:
                rotation = max(rotation, now)
            else:
                position = max(position, now)
    return Worst(*position, *rotation, missing, tuple(found.get("twice", ())))


def case(robot: str) -> Case:
    """Return a robot's exports with their truth, made now or found from before."""
    KEPT.mkdir(parents=True, exist_ok=True)
    place = KEPT / f"{robot}-{_key(robot)}"
    with (KEPT / f"{robot}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # two test processes want the same robot
        if not place.is_dir():
            for old in KEPT.glob(f"{robot}-*"):
                shutil.rmtree(old)
            aside = KEPT / f".{robot}"
            shutil.rmtree(aside, ignore_errors=True)
            _make(robot, aside)
            aside.rename(place)
    motions = {}
    for path in sorted((place / "truth").glob("*.npz")):
        with np.load(path) as kept:
            links = {n.removeprefix("link_"): kept[n] for n in kept.files if n.startswith("link_")}
            motions[path.stem] = Motion(kept["times"], links, float(kept["duration"]))
    return Case(robot, place / "export", motions)


def _key(robot: str) -> str:
    """Return a hash of everything an export is made from."""
    described = files(robot)
    sources = [*(ROOT / "twin").rglob("*.py"), Path(__file__)]
    sources += [p for f in (described.description.parent, ROOT / "trajectories" / robot) for p in f.rglob("*.*")]
    digest = hashlib.sha256(repr(motions()).encode())
    for path in sorted(set(sources)):
        if path.is_file() and path.suffix != ".pyc":
            digest.update(str(path.relative_to(ROOT)).encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _make(robot: str, folder: Path) -> None:
    import twin
    from twin.reference import ReferenceModel

    start = time.monotonic()
    loaded = twin.load(robot)
    protocols: Sequence[str] = tuple(p for r, p in motions() if r == robot)
    twin.api.export(loaded, out=folder / "export", to=FORMATS, protocols=protocols)
    truth = folder / "truth"
    truth.mkdir()
    for name in protocols:
        protocol = loaded.protocol(name)
        trajectory = twin.plan(loaded, protocol)
        keys = np.array(json.loads((folder / "export/tracks" / f"{name}.json").read_text("utf-8"))["times"])
        times = keys[np.unique(np.linspace(0, len(keys) - 1, FRAMES).round().astype(int))]
        model = ReferenceModel(loaded.bound(protocol).mechanism)
        run = model.run_poses(trajectory.poses(times), near=trajectory.joints(times))
        links = {f"link_{n}": T for n, T in model.link_poses(run.x).items()}
        np.savez(truth / f"{name}.npz", times=times, duration=trajectory.duration, **links)
    print(f"{robot}: exported and worked out in {time.monotonic() - start:.1f} s")
