"""Write a robot with its motions as layered USD, for simulators (Isaac Sim, Newton, PhysX) and editors.

physics.usda, geometry.usdc          the robot at home with closed loops: the initial state of simulations
motion/<protocol>.usdc               baked poses and joint values at the key times of the clip
<robot>_<protocol>.usda              root layer of the motion; open this file to play the motion
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pxr import Sdf, Usd, UsdPhysics

from twin.core.atomic import Scratch
from twin.core.errors import AssemblyError, StageError
from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.exchange.write.clip import rounded
from twin.exchange.write.order import Order
from twin.model.mechanism import EARTH, Mechanism
from twin.planning.trajectory import Trajectory, key_times
from twin.reference.holding_efforts import holding_efforts
from twin.usd import gf
from twin.usd.read import made_from
from twin.usd.write.layers import describe, new_layer, save

if TYPE_CHECKING:
    from twin.exchange.write.clip import Clip
    from twin.planning.link_motion import LinkMotion

STEPS_PER_SECOND = 1000
"""Time steps per second of the physics scene.

Measured sag of the tool of SHER under gravity: 0.1 mm at 240 steps per second, a few um at 1000.
"""


def write_usd(mechanism: Mechanism, clips: Sequence[Clip], folder: Path) -> list[Path]:
    """Write the stage of a mechanism, and one motion for each clip.

    A stage for simulators requires a mechanism with masses. The times of clips, in s, become time codes at 60 per
    second.

    Returns:
        The files written, root layer first.

    Raises:
        StageError: UsdPhysics cannot hold a joint, or a clip does not match the mechanism.
        AssemblyError: the loops of the mechanism cannot be closed.
    """
    from twin.reference import ReferenceModel
    from twin.usd.write import BakedMotion, write_motion, write_stage

    model = ReferenceModel(mechanism)
    home = model.home()
    try:
        efforts = holding_efforts(model, home)
    except AssemblyError:  # loops cannot be closed, or there are more drives than degrees of freedom
        efforts = {}
    files = write_stage(mechanism, folder, rounded(home.link_poses), home.q_full, efforts=efforts)
    out = [files.root, files.physics, files.geometry, write_simulated(mechanism.name, folder, mechanism.gravity)]
    for clip in clips:
        motion = BakedMotion(clip.name, clip.times, rounded(clip.links), clip.joints, clip.trocars)
        baked = write_motion(mechanism, folder, motion)
        out += [baked.root, baked.layer]
    return out


def bake(mechanism: Mechanism, bound: Mechanism, protocol: str, motion: LinkMotion, folder: Path) -> None:
    """Add the motion of a protocol to the stage of `mechanism` in `folder`; its times become time codes.

    `bound` is the mechanism with the trocar positions of the protocol.
    """
    from twin.usd.write import BakedMotion, write_motion

    baked = BakedMotion(protocol, motion.times, rounded(motion.links), rounded(motion.joints), bound.trocar_places)
    write_motion(mechanism, folder, baked)


def baked_times(trajectory: Trajectory) -> Array:
    """Return the times (k,) in s of a baked motion: every 1/60 s, and the end."""
    from twin.usd.write.layers import TIME_CODES_PER_SECOND

    return key_times(trajectory.duration, TIME_CODES_PER_SECOND)


def write_simulated(name: str, folder: Path, gravity: tuple[float, float, float] = EARTH) -> Path:
    """Write <name>_sim.usda, which adds a physics scene to the layer <name>.usda of the same folder.

    `gravity` is the gravitational acceleration of the scene in m/s2, in the world.

    The physics scene is outside the default prim. Therefore another stage can reference the robot without getting a
    second physics scene.
    """
    layer = new_layer(path := folder / f"{name}_sim.usda")
    describe(layer, name)
    layer.comment = (
        f"{name} in a physics scene with {STEPS_PER_SECOND} time steps per second, the rate tested with PhysX on a CPU."
    )
    _add_scene(layer, gravity)
    # Set the sublayers last, when no stage is open: USD resolves them at once, but this layer has no path yet.
    layer.subLayerPaths = [f"./{name}.usda"]
    return save(layer, path)


def _add_scene(layer: Sdf.Layer, gravity: tuple[float, float, float]) -> None:
    stage = Usd.Stage.Open(layer)
    scene = UsdPhysics.Scene.Define(stage, "/physicsScene")
    size = float(np.linalg.norm(gravity))
    direction = np.array(gravity) / size if size else np.array([0.0, 0.0, -1.0])
    scene.CreateGravityDirectionAttr(gf.vec3f(direction))
    scene.CreateGravityMagnitudeAttr(size)
    prim = scene.GetPrim()
    prim.AddAppliedSchema("PhysxSceneAPI")
    for name, kind, value in (
        ("timeStepsPerSecond", Sdf.ValueTypeNames.UInt, STEPS_PER_SECOND),
        ("solverType", Sdf.ValueTypeNames.Token, "TGS"),
        # By default, gravity is applied once per step, before the solver iterations, which opens loops.
        ("enableExternalForcesEveryIteration", Sdf.ValueTypeNames.Bool, True),
    ):
        prim.CreateAttribute(f"physxScene:{name}", kind, False).Set(value)
    # The only integrator of MuJoCo (also as a solver of Newton) that solves drives and loop closures together.
    prim.CreateAttribute("mjc:option:integrator", Sdf.ValueTypeNames.Token, False).Set("discrete")


@contextlib.contextmanager
def fresh_stage(stage: Path, source: str, weighed: Callable[[], Mechanism]) -> Iterator[Path]:
    """Yield the path of a robot's USD stage: `stage` if it is up to date, else a new stage in a temporary folder.

    `source` is the current `Mechanism.source` of the robot: description and hash of the CAD. `weighed` is a function
    that returns the mechanism with masses; it is called only if a new stage is written.
    """
    if stage.is_file():
        with contextlib.suppress(StageError):
            if made_from(stage) == source:
                yield stage
                return
    with Scratch() as folder:
        yield write_usd(weighed(), (), Path(folder))[0]


def write(order: Order, folder: Path) -> list[Finding]:
    """Write the stages of a robot and of its motions into `folder`/usd."""
    write_usd(order.mechanism, order.clips, folder / "usd")
    return []


def files(order: Order) -> list[tuple[str, str]]:
    """Return (file, content) for README.txt."""
    name = order.mechanism.name
    rows = [
        (f"usd/{name}.usda", "the robot for simulators and editors: physics.usda over geometry.usdc"),
        (f"usd/{name}_sim.usda", "the same robot in a physics scene: open this file to simulate"),
    ]
    for clip in order.clips:
        rows.append((f"usd/{name}_{clip.name}.usda", f"the same robot, playing {clip.name}"))
    return rows
