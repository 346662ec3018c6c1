"""Check a URDF against the closure YAML beside it: its driven joints, its home, and its loops along tracks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from twin.exchange.audit import poses
from twin.exchange.audit.chain_poses import chain_end, solve_chain
from twin.exchange.audit.file_content import FileClip
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.poses import Array
from twin.exchange.formats.urdf.audit.closures import (
    HOME_GAP_LIMIT,
    TRACK_GAP_LIMIT,
    ClosurePair,
    FileClosures,
    check_gap,
)
from twin.exchange.formats.urdf.audit.tree import TreePath, UrdfTree

LIMIT_ROUNDING = 1e-6
"""Difference of limits and joint values in rad or m that is only rounding: files state about seven digits."""


def check_driven_joints(closures: FileClosures, driven: frozenset[str], file: str, ledger: Ledger) -> None:
    """Report joints that only one of the transmissions, `driven`, and the closure YAML `file` names as driven."""
    driven_in_yaml = frozenset(closures.driven)
    if driven != driven_in_yaml:
        differing = ", ".join(sorted(driven ^ driven_in_yaml))
        text = f"the transmissions and 'name_mot' of {file} do not name the same driven joints: {differing}."
        ledger.wrong("urdf.driven", text, differing)


def check_driven_order(closures: FileClosures, listed: Sequence[str], file: str, ledger: Ledger) -> None:
    """Report driven joints that the closure YAML `file` has in another order than the transmissions, `listed`.

    Readers of the YAML count the values of the motors in this order.
    """
    # Joints that only one of the two has are reported by `check_driven_joints`.
    order = [joint for joint in closures.driven if joint in listed]
    expected = [joint for joint in listed if joint in order]
    if order == expected:
        return
    first_difference = 0
    while order[first_difference : first_difference + 1] == expected[first_difference : first_difference + 1]:
        first_difference += 1
    text = (
        f"'name_mot' of {file} has the driven joints in another order than the transmissions: "
        f"{', '.join(order[first_difference:])}, expected {', '.join(expected[first_difference:])}."
    )
    advice = "export the URDF and its YAML together"
    ledger.wrong("urdf.driven_order", text, order[first_difference], suggestion=advice)


def check_home(tree: UrdfTree, closures: FileClosures, file: str, ledger: Ledger) -> None:
    """Report loops that are open, and joints outside their limits, at `home` of the closure YAML `file`."""
    home = closures.home
    if not home:
        return
    for joint in tree.joints:
        if joint.name in home and joint.limits is not None:
            low, high = joint.limits
            if not low - LIMIT_ROUNDING <= home[joint.name] <= high + LIMIT_ROUNDING:
                text = (
                    f"{file}: joint '{joint.name}' is at {home[joint.name]:g} at home, outside its limits "
                    f"{low:g} .. {high:g}."
                )
                ledger.wrong("urdf.limits", text, joint.name)
    for pair in closures.pairs:
        T_root_first = tree.link_pose(pair.first, home)
        T_root_second = tree.link_pose(pair.second, home)
        check_gap(pair, T_root_first, T_root_second, f"{file}, home", HOME_GAP_LIMIT, ledger)


def check_loop_ends(
    tree: UrdfTree, closures: FileClosures, is_part: Callable[[str], bool], file: str, ledger: Ledger
) -> None:
    """Report two links that look like the ends <joint>_a and <joint>_b of a loop, but of none in the YAML `file`.

    Only a YAML whose loops all have such ends is judged: others may name links in any way. `is_part` returns whether a
    link has a shape or a mass, so that it is no mere end of a loop.
    """
    ends: set[str] = set()
    for pair in closures.pairs:
        if not pair.first.endswith("_a") or pair.second != _other_end(pair.first):
            return
        ends.update((pair.first, pair.second))
    parents = {joint.parent for joint in tree.joints}
    for first in tree.links:
        second = _other_end(first)
        if not first.endswith("_a") or second not in tree.links or {first, second} & (ends | parents):
            continue
        if is_part(first) or is_part(second):
            continue
        text = f"{file} closes no loop between links '{first}' and '{second}', which have no other purpose."
        advice = "add the two links to 'closed_loop', and their type; or remove them from the URDF"
        ledger.wrong("urdf.loop_missing", text, first.removesuffix("_a"), suggestion=advice)


def _other_end(first: str) -> str:
    """Return the name of the second link of a loop whose first one is <joint>_a."""
    return f"{first.removesuffix('_a')}_b"


def check_loop_along(
    tree: UrdfTree, pair: ClosurePair, link_poses: Mapping[str, Array], clip: FileClip, ledger: Ledger
) -> None:
    """Report a loop that is open at a key of a clip; `link_poses` contains poses (k, 4, 4) of links in this clip.

    Joint values that the clip lacks are those that close the loop best.
    """
    paths: list[TreePath] = []
    for link in (pair.first, pair.second):
        if link in link_poses:
            paths.append(TreePath(link, ()))
        else:
            paths.append(tree.path_from(link, link_poses))
    # The end with more joints is fitted to the other one, because it has more values to choose.
    goal_path, fitted_path = sorted(paths, key=lambda path: path.moving_count)
    count = len(clip.times)
    T_world_ancestor = link_poses[fitted_path.ancestor]
    T_world_goal = link_poses[goal_path.ancestor] @ chain_end(goal_path.steps, goal_path.values(clip), count)
    T_ancestor_goal = poses.inverse(T_world_ancestor) @ T_world_goal
    values = solve_chain(fitted_path.steps, fitted_path.values(clip), T_ancestor_goal)
    T_world_fitted = T_world_ancestor @ chain_end(fitted_path.steps, values, count)
    check_gap(pair, T_world_goal, T_world_fitted, f"clip '{clip.name}'", TRACK_GAP_LIMIT, ledger)
