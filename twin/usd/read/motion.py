"""Read baked poses at the time codes of their samples."""

from __future__ import annotations

from pathlib import Path

from twin.core.errors import StageError
from twin.core.spatial import Array
from twin.usd.read.bodies import original_name
from twin.usd.read.names import unique
from twin.usd.scan import Scene


def read_motion(path: str | Path, root: str | None = None) -> tuple[Array, dict[str, Array]]:
    """Return the sample times and the poses of all rigid bodies of a stage.

    If bodies have samples at different time codes, all bodies are evaluated at every time code of any body; USD then
    interpolates poses. Bodies or their ancestors have time samples. Only bodies below the prim path `root` are read;
    None: all bodies.

    Returns:
        (times, poses): times (k,) in s from time code 0; T_world_body (k, 4, 4) in metres, world z up, by the body
        names of `read_stage`.

    Raises:
        StageError: the file cannot be read or no body moves.
    """
    scene = Scene(path)
    codes = scene.sample_codes
    if not len(codes):
        raise StageError(f"{scene.path}: no transform of a rigid body has time samples")
    bodies = {p: b for p, b in scene.bodies.items() if not root or p == root or p.startswith(f"{root}/")}
    names = unique((p, original_name(b)) for p, b in bodies.items())
    poses = scene.poses(list(bodies.values()), codes)
    times = codes / scene.stage.GetTimeCodesPerSecond()
    return times, {names[p]: T for p, T in zip(bodies, poses, strict=True)}
