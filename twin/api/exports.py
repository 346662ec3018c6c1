"""Write a robot's USD stage, and export a robot with its motions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from twin.api.protocol_plan import plan
from twin.api.robot import Robot
from twin.api.robot_loading import loaded, names
from twin.core import assets
from twin.core.errors import ProtocolError, TwinError
from twin.core.progress import Progress, silent

if TYPE_CHECKING:
    from twin.exchange.write.bundle import Bundle
    from twin.exchange.write.clip import ClipAccuracy
    from twin.planning.trajectory import Trajectory


def build(
    robot: Robot | str | Path,
    out: str | Path | None = None,
    *,
    protocols: tuple[str, ...] | None = None,
    progress: Progress = silent,
) -> list[Path]:
    """Write the robot's USD stage: meshes, masses, joints, and one baked motion for each protocol.

    Args:
        robot: a robot with CAD, its name or its folder. If it has no equations yet, motions that the mechanism cannot
            follow are skipped.
        out: folder to write; default: usd/<robot>/ in a checkout, usd/ in the folder of a user's robot.
        protocols: protocols whose motions are baked; default: all.
        progress: see `Progress`.

    Returns:
        The files written, root layer first.

    Raises:
        TwinError: the robot was loaded from a stage, or cannot be built; or `out` is None for a built-in robot of an
            installed package, whose data are read-only.
        OutputError: the folder cannot be written; it stays unchanged.

    Examples:
        >>> import twin
        >>> files = twin.build("hibou", out="stage", protocols=())
        >>> files[0].name
        'hibou.usda'
    """
    from twin.exchange.formats.usd.write import bake, baked_times, write_usd

    robot = loaded(robot)
    if robot.files is None:
        raise TwinError(f"{robot.name} was loaded from {robot.source.kind}: there is no CAD to build from")
    if out is None:
        if not assets.is_checkout() and robot.name in names():
            raise TwinError("the installed data is read-only: choose a folder with --out")
        folder = robot.files.usd
    else:
        folder = Path(out)
    progress("read CAD, compute masses", 0.0)
    robot = robot.weighed()  # a stage states masses, for physics engines
    assert robot.files is not None
    chosen = protocols or ()
    if protocols is None and (robot.files.has_equations or robot.unwritten):
        chosen = tuple(robot.files.protocols())
    with assets.atomic_folder(folder) as work:
        root = write_usd(robot.mechanism, (), work)[0]
        for i, name in enumerate(chosen):
            progress(f"bake {name}", i / len(chosen))
            try:
                bound = robot.bound(robot.protocol(name))
                trajectory = plan(robot, name)
            except ProtocolError:
                if protocols is None and robot.unwritten:  # `twin plan` shows the reason
                    continue
                raise
            motion = bound.link_motion(trajectory, baked_times(trajectory))
            bake(robot.mechanism, bound.mechanism, trajectory.protocol, motion, work)
        first = root.relative_to(work)
        other_files = []
        for path in work.rglob("*"):
            if path.is_file() and path != root:
                other_files.append(path.relative_to(work))
    # the files have moved from the temporary folder into `folder`
    return [folder / name for name in (first, *sorted(other_files))]


def export(
    robot: Robot | str | Path,
    trajectory: Trajectory | None = None,
    out: str | Path | None = None,
    to: str | Sequence[str] | None = None,
    *,
    protocols: Sequence[str | Path] | None = None,
    budget: ClipAccuracy | None = None,
    progress: Progress = silent,
) -> Bundle:
    """Write the robot with its motions for headsets, engines and simulators, and audit the written files.

    Args:
        robot: a robot with CAD, its name or its folder; or a USD stage (with the motion baked in the stage, if any); or
            a description file, which is exported without motion.
        trajectory: a planned trajectory as the only motion; None: the motions of the protocols. Its protocol is the
            first in `protocols` or, without `protocols`, the one that the trajectory names.
        out: folder to write; default: ./twin-out/<robot>/export/.
        to: names of formats, as ["glb", "tracks"] or "glb,tracks"; default: all that `twin export --help` lists.
        protocols: names or paths; default: every protocol of the robot.
        budget: maximum interpolation errors between keys; the key rate is chosen accordingly.
        progress: see `Progress`.

    Returns:
        The written files, with the findings of the robot, the writers and the audit.

    Raises:
        TwinError: an input is missing or malformed; the folder stays unchanged.

    Examples:
        >>> import twin
        >>> bundle = twin.export("hibou", to="glb", out="export", protocols=())
        >>> bundle.verdict
        'agree'
    """
    from twin.exchange.audit import audit
    from twin.exchange.write.bundle import chosen_formats, write_bundle
    from twin.exchange.write.order_of_robot import order_of_robot

    if isinstance(trajectory, (str, Path)):
        raise TwinError(f"'{trajectory}' is not a trajectory: write out='{trajectory}' for a folder")
    if isinstance(to, str):
        to = [name.strip() for name in to.split(",") if name.strip()]
    kinds = chosen_formats(to)
    robot = loaded(robot)
    folder = Path(out or Path("twin-out") / robot.name / "export")
    assets.require_writable(folder)  # before planning, which can take minutes
    ordered = order_of_robot(robot, trajectory, protocols, budget, plan, progress)
    return write_bundle(ordered, folder, kinds, audit, progress)
