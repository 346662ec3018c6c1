"""Compare two or more descriptions of one robot: files, robot folders, built-in robots."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from twin.api.robot import Robot
from twin.api.robot_loading import load, names
from twin.api.robot_source import RobotSource
from twin.core import spatial
from twin.core.errors import AssemblyError, TwinError, unknown
from twin.core.foreign.budget import STAGE_SUFFIXES
from twin.core.progress import Progress, silent
from twin.core.quantity import moved
from twin.core.spatial import Array

if TYPE_CHECKING:
    from twin.comparison.comparison_result import Comparison
    from twin.comparison.side import DhTableRow, PoseRows, RobotSide
    from twin.exchange.read.imported_robot import DhOptions
    from twin.exchange.read.pose_table import ReadPoses
    from twin.exchange.xacro import XacroSettings
    from twin.kinematics import Kinematics
    from twin.model.mechanism import Mechanism

EQUATIONS = "@equations"
"""End of the name of a side that is the equations of a robot: pa10@equations."""

_EQUATION_STATES = 100
"""Number of states at which equations without joint lines are computed."""

_FEWEST_POSES = 12
"""Fewest of these states that must have a pose."""

_SEED_OF_STATES = 11

_LARGEST_TURN = 0.4
"""Largest distance from home of these states in rad."""

_LARGEST_SLIDE = 0.02
"""Largest distance from home of these states in m."""

_LARGEST_TILT = 0.15
"""Largest rotation about an axis from the home pose in rad."""

_MOST_FOLDERS = 10
"""Maximum number of folders that the labels of two files of one name show."""

TOLERANCE = 1e-5
"""Distance in m up to which two joint lines coincide: files round rotations to four or five digits."""


def compare(
    *sides: str | Path | Robot,
    tolerance: float = TOLERANCE,
    only: Sequence[str] = (),
    strict: bool = False,
    xacro: XacroSettings | None = None,
    dh: str | None = None,
    units: str | None = None,
    progress: Progress = silent,
) -> Comparison:
    """Compare two or more descriptions of one robot, pair by pair.

    Args:
        sides: names of built-in robots, robots, robot folders, files of formats that `twin new` reads, or tables of
            poses (CSV). A name or a folder with "@equations" at its end is its equations instead of its mechanism.
        tolerance: distance in m up to which two joint lines coincide; angles count by the distance at half a metre.
        only: joints to compare; all others are held at zero.
        strict: count a difference of convention (base frame, zero, sign, tool frame, name, order) as a disagreement.
        xacro: arguments and package folders for the xacros among the sides.
        dh: convention of the tables of Denavit-Hartenberg parameters among the sides, if they do not state it:
            "standard", "modified", "khalil" or "hayati".
        units: units of these tables and of tables of poses, as "mm,deg", if they do not state them.
        progress: see `Progress`.

    Raises:
        TwinError: a side cannot be read, or its joints cannot be matched with those of another.

    Examples:
        >>> import twin
        >>> twin.compare("pa10", "pa10@equations").verdict
        'agree'
    """
    from twin.comparison.comparison_result import Comparison
    from twin.comparison.pair import compare_pair
    from twin.exchange.read.imported_robot import dh_options
    from twin.exchange.read.shapes import mesh_cache

    if len(sides) < 2:
        raise TwinError("give at least two sides to compare: names of robots, folders or files")
    if not tolerance > 0:
        raise TwinError(f"tolerance {tolerance:g} m: give a positive number")
    labels = _labels(sides)
    table = dh_options(dh, units)
    has_table = any(map(_is_table, sides))
    if (dh or units) and not has_table:
        raise TwinError("--dh and --units are for tables (CSV, TOML, Markdown, LaTeX), but no side is one: omit them")
    read_sides = []
    pairs = []
    with ExitStack() as copies, mesh_cache():  # a file is read again with other numbers and the same meshes
        for i, side in enumerate(sides):
            progress(f"read {labels[i]}", i / (2 * len(sides)))
            read_sides.append(_side(side, labels[i], only, xacro, table, copies))
        pairs_of_sides = list(combinations(read_sides, 2))
        for i, (first, second) in enumerate(pairs_of_sides):
            progress(f"compare {first.label} and {second.label}", 0.5 + i / (2 * len(pairs_of_sides)))
            pairs.append(compare_pair(first, second, tolerance))
    return Comparison(tuple(read_sides), tuple(pairs), tolerance, strict)


def _labels(sides: Sequence[str | Path | Robot]) -> list[str]:
    """Return a short, distinct name for each side: the name of its file, with as many folders as are needed."""
    texts = []
    for side in sides:
        texts.append(side.name if isinstance(side, Robot) else str(side))
    for depth in range(1, _MOST_FOLDERS + 2):
        labels = []
        for text in texts:
            parts = Path(text).parts[-depth:]
            label = "/".join(parts)
            if len(parts) > 2:  # folders that all have in common say nothing
                label = f"{parts[0]}/…/{parts[-1]}"
            labels.append(label)
        if len(set(labels)) == len(labels):
            return labels
    # one file is given twice
    return [f"{text} ({i + 1})" for i, text in enumerate(texts)]


def _is_table(stated_side: str | Path | Robot) -> bool:
    """Return whether a side is a file with a table."""
    from twin.exchange.read import format_of

    if isinstance(stated_side, Robot) or Path(stated_side).is_dir() or str(stated_side).endswith(EQUATIONS):
        return False
    suffix = Path(stated_side).suffix.lower()
    if suffix in STAGE_SUFFIXES:
        return False
    if not suffix and str(stated_side) in names():  # the name of a built-in robot has no suffix
        return False
    return "table" in format_of(Path(stated_side)).takes


def _side(
    stated_side: str | Path | Robot,
    label: str,
    only: Sequence[str],
    xacro: XacroSettings | None,
    table: DhOptions,
    copies: ExitStack,
) -> RobotSide:
    """Return a side as it was stated; `label` is its name in the result, `only` the joints that may move."""
    from twin.exchange.read.pose_table import is_pose_table

    if isinstance(stated_side, Robot):
        return _robot_side(stated_side, label, only)
    if str(stated_side).endswith(EQUATIONS):
        return _equations_side(str(stated_side).removesuffix(EQUATIONS), label, only)
    path = Path(stated_side)
    if is_pose_table(path):
        return _table_side(path, label, only, table)
    is_stage = path.suffix.lower() in STAGE_SUFFIXES
    if is_stage and path.is_file():
        side = replace(_robot_side(load(stated_side), label, only), path=path)
        reread = _reread_stage(path, label, only, copies)
        if side.has_loops:  # the stage has other names and another order than the compared tree
            return replace(side, reread_closed=reread)
        return replace(side, reread=reread)
    if str(stated_side) in names() or path.is_dir() or is_stage:
        return _robot_side(load(stated_side), label, only)
    return _described_side(path, label, only, xacro, table, copies)


def _described_side(
    path: Path,
    label: str,
    only: Sequence[str],
    xacro: XacroSettings | None,
    table: DhOptions,
    copies: ExitStack,
) -> RobotSide:
    """Return the side of a description file (URDF, xacro, MJCF, SDF, a table of Denavit-Hartenberg parameters, ...)."""
    from twin.exchange.xacro import SUFFIX, XacroSettings, expand, is_xacro

    settings = xacro or XacroSettings()
    text = None
    places: Mapping[str, tuple[str, int]] = {}
    reader_settings = None
    if path.is_file() and path.suffix.lower() in (SUFFIX, ".urdf") and is_xacro(path):
        expanded = expand(path, settings)
        text = expanded.data
        places = expanded.places
        reader_settings = settings
    side = _file_side(path, label, only, reader_settings, table)
    side = replace(side, text=text, xacro_places=places)
    reread = _reread(path, label, only, table, copies, text)
    if side.has_loops:  # to close the loops again for each number would take minutes
        return replace(side, reread_closed=reread)
    return replace(side, reread=reread)


def _file_side(
    path: Path,
    label: str,
    only: Sequence[str],
    xacro: XacroSettings | None,
    table: DhOptions,
    guarded: bool = True,
) -> RobotSide:
    from twin.comparison.mechanism_side import from_mechanism
    from twin.exchange.read import read
    from twin.exchange.read.loop_closing import close

    imported = read(path, guarded=guarded, xacro=xacro, dh=table if _is_table(path) else None)
    if imported.mechanism.loops:
        imported = close(imported)
    guessed = False
    notes = []
    for finding in imported.findings:
        # a tool that the reader has chosen may be another link than the tool of the other side
        if finding.code == "import.tool" and finding.severity == "warning":
            guessed = True
        if finding.code == "import.inertia":
            notes.append(finding.message)
    side = from_mechanism(
        imported.mechanism,
        label,
        path=path,
        only=only,
        guessed_tool=guessed,
        notes=notes,
        efforts=imported.efforts,
        unlimited=imported.unlimited,
    )
    if _is_table(path):
        joint_names = [joint.name for joint in imported.mechanism.tree]
        return replace(side, dh_rows=_dh_rows(path, table, joint_names))
    return replace(side, tool_poses=_poses_of(imported.mechanism, side))


def _reread(
    path: Path, label: str, only: Sequence[str], table: DhOptions, copies: ExitStack, text: bytes | None
) -> Callable[[bytes], RobotSide] | None:
    """Return a function that reads a changed text of a file; its first text was read in a guarded process.

    None if the numbers of the file are no text: `text` is the one that was read, if it is not that of the file.
    """
    from twin.comparison.file_numbers import has_numbers

    data = _bytes_of(path) if text is None else text
    if data is None or not has_numbers(data, table=_is_table(path)):
        return None
    suffix = path.suffix
    if suffix.lower() == ".xacro":
        suffix = ".urdf"  # the text is the expanded one

    def read_copy(copy: Path) -> RobotSide:
        return _file_side(copy, label, only, None, table, guarded=False)

    return _CopyReader(path, data, suffix, read_copy, copies).read


def _reread_stage(
    path: Path, label: str, only: Sequence[str], copies: ExitStack
) -> Callable[[bytes], RobotSide] | None:
    """Return the same for a USD stage; None for a stage in binary form."""
    from twin.comparison.file_numbers import has_numbers

    data = _bytes_of(path)
    if data is None or not has_numbers(data, table=False):
        return None

    def read_copy(copy: Path) -> RobotSide:
        return _robot_side(Robot(RobotSource(stage=copy)), label, only)

    return _CopyReader(path, data, path.suffix, read_copy, copies).read


def _bytes_of(path: Path) -> bytes | None:
    """Return the content of a file; None if it cannot be read."""
    try:
        return path.read_bytes()
    except OSError:
        return None


class _CopyReader:
    """A temporary folder in which changed texts of one file are read again.

    It has the entries of the file's folder, and of the two folders above, at the same depth, so that references to
    them, also those with `../`, lead to the same files. It is made at the first text, and removed when `copies` is
    closed.
    """

    def __init__(
        self, path: Path, data: bytes, suffix: str, read_copy: Callable[[Path], RobotSide], copies: ExitStack
    ) -> None:
        self._path = path.resolve()
        self._name = path.stem
        self._data = data
        self._suffix = suffix
        self._read_copy = read_copy
        self._copies = copies
        self._folder: Path | None = None
        self._failed = False
        self._count = 0

    def read(self, data: bytes) -> RobotSide:
        """Return the side with another text.

        Raises:
            TwinError: the text cannot be read, or the unchanged text cannot be read in this folder.
        """
        if self._failed:  # each number of the file is tried: to fail again and again would take minutes
            raise TwinError(f"{self._path}: a copy in another folder cannot be read")
        if self._folder is None:
            try:
                self._folder = self._make_folder()
                # if a reference does not lead to its file from here, the unchanged text fails as well
                self._read(self._folder, self._data)
            except (OSError, TwinError) as error:
                self._failed = True
                raise TwinError(f"{self._path}: a copy in another folder cannot be read: {error}") from error
        try:
            return self._read(self._folder, data)
        except OSError as error:
            raise TwinError(f"{self._path}: a changed text cannot be read: {error}") from error

    def _read(self, folder: Path, data: bytes) -> RobotSide:
        # a name for each text: USD keeps the layers of the files that it has read
        self._count += 1
        copy = folder / f"{self._name}_{self._count}{self._suffix}"
        copy.write_bytes(data)
        try:
            return self._read_copy(copy)
        finally:
            copy.unlink()

    def _make_folder(self) -> Path:
        """Return the folder of the copies, as deep as the original, each folder with links to the other entries."""
        folder = Path(self._copies.enter_context(TemporaryDirectory(prefix="twin-compare-")))
        original = self._path.parent
        levels = [original.parent.parent, original.parent, original]
        for above, below in pairwise(levels):
            if above == below:  # the root
                continue
            _link_entries(above, folder, below.name)
            folder = folder / below.name
            folder.mkdir()
        _link_entries(original, folder, "")
        return folder


def _link_entries(source: Path, folder: Path, omitted: str) -> None:
    """Make links in a folder to the entries of another one, except one name."""
    for entry in source.iterdir():
        if entry.name != omitted:
            (folder / entry.name).symlink_to(entry)


def _dh_rows(path: Path, options: DhOptions, names: Sequence[str]) -> tuple[DhTableRow, ...]:
    """Return the rows of a table; `names` are those of its joints, whose bodies are link1, link2, ..."""
    from twin.comparison.side import DhTableRow
    from twin.exchange.formats.dh.table import read_table, unit_size

    table = read_table(path, options)
    links = []
    for number in range(1, len(names) + 1):
        links.append(f"link{number}")
    rows = []
    for i, (row, name) in enumerate(zip(table.rows, names, strict=True)):
        values = {}
        units = {}
        for parameter, quantity in row.values.items():
            values[parameter] = quantity.value
            units[parameter] = unit_size(quantity.unit)
        # a changed number moves what is behind it in the chain: these joints and frames
        below = frozenset(names[i + 1 :])
        frames = frozenset([*links[i:], "tool"])
        rows.append(DhTableRow(str(path), row.line, name, links[i], table.convention, values, units, below, frames))
    return tuple(rows)


def _robot_side(robot: Robot, label: str, only: Sequence[str]) -> RobotSide:
    from twin.comparison.mechanism_side import from_mechanism

    unlimited: Collection[str]
    if robot.files is None:
        mechanism = robot.mechanism
        # in the schema of USD, a joint without limits is not limited: a stage cannot leave them open
        unlimited = [joint.name for joint in mechanism.tree]
        efforts: Mapping[str, float] = {}
        if robot.source.described is not None:
            unlimited = robot.source.described.unlimited
            efforts = robot.source.described.efforts
        side = from_mechanism(
            mechanism,
            label,
            path=robot.source.path,
            only=only,
            guessed_tool=bool(robot.tool_note),
            efforts=efforts,
            unlimited=unlimited,
        )
    else:
        mechanism = robot.weighed().mechanism
        stated: list[str] = []
        for limit in robot.source.description.limit:
            if limit.limits == "none":
                stated += limit.joints
        unlimited = stated
        side = from_mechanism(mechanism, label, path=robot.files.description, only=only, unlimited=unlimited)
    return replace(side, tool_poses=_poses_of(mechanism, side))


def _poses_of(mechanism: Mechanism, side: RobotSide) -> Callable[[Array], Array] | None:
    """Return the function that closes the loops of a mechanism by the reference model; None without loops."""
    if not side.has_loops:
        return None

    def poses(q: Array) -> Array:
        from twin.reference import ReferenceModel

        model = ReferenceModel(mechanism)
        states = np.repeat(model.home().q[None], len(q), axis=0)
        active_names = [joint.name for joint in mechanism.active]
        for k, name in enumerate(side.driven_joints):
            # NaN: the joint has no value at this state, so it stays at home
            is_stated = np.isfinite(q[:, k])
            states[is_stated, active_names.index(name)] = q[is_stated, k]
        try:
            return model.solve_many(states).Ts_base_tool
        except AssemblyError:  # one state opens the loops: the others are still comparable
            pass
        Ts = np.full((len(q), 4, 4), np.nan)
        for k, state in enumerate(states):
            with contextlib.suppress(AssemblyError):
                Ts[k] = model.solve_many(state[None]).Ts_base_tool[0]
        return Ts

    return poses


def _table_side(path: Path, label: str, only: Sequence[str], table: DhOptions) -> RobotSide:
    """Return the side of a table of poses."""
    from twin.comparison.side import JointGroup, PoseRows, RobotSide
    from twin.exchange.read.pose_table import read_poses

    read = read_poses(path, table.length, table.angle)
    columns = _chosen_columns(read, label, only)
    rows = PoseRows(
        tuple(read.joints[column] for column in columns),
        tuple(read.angles[column] for column in columns),
        read.q[:, columns],
        read.T,
        read.rotations,
        read.lines,
        read.noise,
    )
    base = (JointGroup(("base",)),)
    return RobotSide(
        label,
        path.stem,
        (),
        base,
        {"base": (0, np.eye(4))},
        tool="base",
        driven_joints=rows.joints,
        path=path,
        sample_poses=lambda: rows,
    )


def _chosen_columns(read: ReadPoses, label: str, only: Sequence[str]) -> list[int]:
    """Return the columns of the joints to compare; the values of all others must be zero, where they are held."""
    from twin.comparison.side import plain_name

    if not only:
        return list(range(len(read.joints)))
    chosen_columns = set()
    for name in only:
        columns = []
        for i, joint in enumerate(read.joints):
            if plain_name(joint) == plain_name(name):
                columns.append(i)
        if name in read.joints:  # of names that differ only in case or signs, the same one is meant
            columns = [read.joints.index(name)]
        if len(columns) != 1:
            raise TwinError(f"{label}: {unknown('joint of the table', name, read.joints)}")
        chosen_columns.add(columns[0])
    for i, name in enumerate(read.joints):
        displaced = np.flatnonzero(read.q[:, i])
        if i in chosen_columns or not len(displaced):
            continue
        first = int(displaced[0])
        place = f"{label}:{read.lines[first]}"
        value = moved(float(read.q[first, i]), read.angles[i])
        raise TwinError(
            f"{place}: joint '{name}' is at {value}, but --only holds it at zero. Remove the rows where it is not "
            "zero, or compare it as well"
        )
    return sorted(chosen_columns)


def _equations_side(source: str, label: str, only: Sequence[str]) -> RobotSide:
    """Return the side of the equations of a robot; its formula.py is executed, with the consent of the user."""
    from twin.comparison.screws import NotAChainError, chain_of
    from twin.comparison.side import JointGroup, RobotSide

    robot = load(source)
    if robot.unwritten:
        raise TwinError(f"{source}: formula.py is still the empty template: write the equations, or omit {EQUATIONS}")
    kin = robot.kinematics()
    joints = kin.formula.joints
    order = []
    kinds = []
    for joint in joints:
        order.append(joint.name)
        kinds.append(joint.kind)
    for name in only:
        if name not in order:
            raise TwinError(f"{label}: {unknown('joint of the equations', name, order)}")
    columns = [kin.joints.index(name) for name in order]

    def forward(q: Array) -> Array:
        all_joints = np.zeros((len(q), len(kin.joints)))
        all_joints[:, columns] = q
        return kin.forward_many(all_joints)

    base = (JointGroup(("base",)),)
    side = RobotSide(label, robot.name, (), base, {"base": (0, np.eye(4))}, tool="base", driven_joints=tuple(order))
    if kin.closed_forward:
        # equations of a robot with loops have no joint lines: only their poses are compared
        with contextlib.suppress(NotAChainError):
            side = chain_of(forward, tuple(order), tuple(kinds), label, robot.name, only)
    return replace(side, sample_poses=lambda: _sampled_poses(robot, kin, forward))


def _sampled_poses(robot: Robot, kin: Kinematics, forward: Callable[[Array], Array]) -> PoseRows:
    """Return poses that the equations compute about the home state of the robot.

    The forward equations give them at drawn joint values; equations with only an inverse give joint values at drawn
    poses.
    """
    from twin.comparison.side import PoseRows

    names = []
    angles = []
    columns = []
    columns_of_equations = []
    for joint in kin.formula.joints:
        names.append(joint.name)
        angles.append(joint.kind == "revolute")
        columns.append(robot.joints.index(joint.name))
        columns_of_equations.append(kin.joints.index(joint.name))
    mechanism = robot.mechanism
    home = robot.reference().home()
    rng = np.random.default_rng(_SEED_OF_STATES)
    if kin.closed_forward:
        centre = home.q[columns]
        half = np.where(angles, _LARGEST_TURN, _LARGEST_SLIDE)
        limits = mechanism.limits[columns]
        low = np.maximum(limits[:, 0], centre - half)
        high = np.minimum(limits[:, 1], centre + half)
        q = rng.uniform(low, high, (_EQUATION_STATES, len(names)))
        T = forward(q)
    else:
        rotations = spatial.exp_so3(rng.uniform(-_LARGEST_TILT, _LARGEST_TILT, (_EQUATION_STATES, 3)))
        shifts = rng.uniform(-_LARGEST_SLIDE, _LARGEST_SLIDE, (_EQUATION_STATES, 3))
        T = home.T_base_tool @ spatial.pose(rotations, shifts)
        q = kin.inverse_many(T)[:, columns_of_equations]
        low, high = mechanism.limits[columns].T
        # the other side may refuse states beyond its limits
        q[((q < low) | (q > high)).any(axis=1)] = np.nan
    has_pose = np.isfinite(q).all(axis=1) & np.isfinite(T).all(axis=(1, 2))
    if has_pose.sum() < _FEWEST_POSES:
        raise TwinError(f"{robot.name}: its equations have no poses at {_EQUATION_STATES} states about home")
    return PoseRows(tuple(names), tuple(angles), q[has_pose], T[has_pose], computed=True)
