"""The robot as layered USD with its motions: what simulators (Isaac Sim, Newton, PhysX) and editors open.

physics.usda over geometry.usdc      the robot, assembled at home, simulators start there
motion/<protocol>.usdc               baked poses and joint values at the times of the clip
<robot>_<protocol>.usda              what a person opens to see the motion
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pxr import Gf, Sdf, Usd, UsdPhysics

from twin.cad.build import fingerprint, read_mechanism
from twin.core.assets import RobotFiles
from twin.core.atomic import Scratch
from twin.core.errors import AssemblyError, StageError
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.reference.holding import GRAVITY, holding_efforts
from twin.usd.read import made_from
from twin.usd.write.layers import describe, new_layer, save

if TYPE_CHECKING:
    from twin.exchange.write.clip import Clip
    from twin.planning.trajectory import Trajectory

STEPS_PER_SECOND = 1000
"""Of the scene: at 240 the loops of SHER let its tool sag by 0.1 mm, at 1000 by a few um (measured)."""


def write_usd(mechanism: Mechanism, clips: Sequence[Clip], folder: Path) -> list[Path]:
    """Write the stage of a mechanism and one motion for each clip.

    Args:
        mechanism: weighed, if simulators are to know the masses.
        clips: motions to bake; their times become time codes at 60 a second.
        folder: made if it is missing; the caller moves it into place.

    Returns:
        The files written, root layer first.

    Raises:
        StageError: a joint has what UsdPhysics cannot hold, or a clip does not fit the mechanism.
        AssemblyError: the mechanism cannot be assembled as drawn.
    """
    from twin.reference import ReferenceModel
    from twin.usd.write import Motion, write_motion, write_stage

    model = ReferenceModel(mechanism)
    home = model.home()
    try:
        efforts = holding_efforts(model, home)
    except AssemblyError:  # loops that stay open, or more drives than freedoms: nothing can be moved a little
        efforts = {}
    files = write_stage(mechanism, folder, rounded(home.link_poses), home.q_full, efforts=efforts)
    out = [files.root, files.physics, files.geometry, _write_scene(mechanism, folder / f"{mechanism.name}_sim.usda")]
    for clip in clips:
        motion = Motion(clip.name, clip.times, rounded(clip.links), clip.joints, clip.trocars)
        baked = write_motion(mechanism, folder, motion)
        out += [baked.root, baked.layer]
    return out


def bake(mechanism: Mechanism, bound: Mechanism, trajectory: Trajectory, folder: Path) -> None:
    """Write a planned trajectory beside the stage of `mechanism` in `folder`, every 1/60 s and at its end.

    Args:
        mechanism: as the stage has it.
        bound: the same with its trocar where the protocol has it.
        trajectory: as planned.
        folder: that of the stage.
    """
    from twin.planning.trajectory import key_times
    from twin.reference import ReferenceModel
    from twin.usd.write import Motion, write_motion
    from twin.usd.write.layers import TIME_CODES_PER_SECOND

    times = key_times(trajectory.duration, TIME_CODES_PER_SECOND)
    model = ReferenceModel(bound)
    run = trajectory.on(model, times)
    values = {n: run.q[:, i] for i, n in enumerate(trajectory.joint_names)} | run.q_passive
    motion = Motion(trajectory.protocol, times, rounded(model.link_poses(run.x)), values, bound.trocar_places)
    write_motion(mechanism, folder, motion)


def _write_scene(mechanism: Mechanism, path: Path) -> Path:
    """Write a root layer that adds a physics scene beside the robot, so that referencing the robot leaves it behind."""
    layer = new_layer(path)
    describe(layer, mechanism.name)
    layer.comment = f"{mechanism.name} in a scene, as measured with PhysX on a CPU: {STEPS_PER_SECOND} steps a second."
    _add_scene(layer)
    # Last, when no stage is open: USD looks for sublayers at once, and this layer has no place yet.
    layer.subLayerPaths = [f"./{mechanism.name}.usda"]
    return save(layer, path)


def _add_scene(layer: Sdf.Layer) -> None:
    stage = Usd.Stage.Open(layer)
    scene = UsdPhysics.Scene.Define(stage, "/physicsScene")
    scene.CreateGravityDirectionAttr(Gf.Vec3f(0, 0, -1))
    scene.CreateGravityMagnitudeAttr(GRAVITY)
    prim = scene.GetPrim()
    prim.AddAppliedSchema("PhysxSceneAPI")
    for name, kind, value in (
        ("timeStepsPerSecond", Sdf.ValueTypeNames.UInt, STEPS_PER_SECOND),
        ("solverType", Sdf.ValueTypeNames.Token, "TGS"),
        # Gravity in one lump a step moves a loop before its iterations begin.
        ("enableExternalForcesEveryIteration", Sdf.ValueTypeNames.Bool, True),
    ):
        prim.CreateAttribute(f"physxScene:{name}", kind, False).Set(value)
    # MuJoCo, also as a solver of Newton: the only integrator of its that takes drives and ties in one solve.
    prim.CreateAttribute("mjc:option:integrator", Sdf.ValueTypeNames.Token, False).Set("discrete")


@contextlib.contextmanager
def fresh_stage(files: RobotFiles) -> Iterator[Path]:
    """Yield a robot's USD stage if it was made from the present CAD, else one rebuilt in a temporary folder."""
    if files.stage.is_file():
        with contextlib.suppress(StageError):
            if fingerprint(files.description) in made_from(files.stage):
                yield files.stage
                return
    with Scratch() as folder:
        yield write_usd(read_mechanism(files.description).mechanism, (), Path(folder))[0]


def rounded(poses: Mapping[str, Array]) -> dict[str, Array]:
    """Return poses rounded to 1e-13, so that the last bits of a processor do not reach the file."""
    return {name: np.round(T, 13) + 0.0 for name, T in poses.items()}
