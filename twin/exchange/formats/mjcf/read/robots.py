"""Group the bodies of an MJCF into robots. Top-level bodies that equalities or tendons connect belong to one robot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from twin.core.errors import SourceError, UnsupportedError, unknown
from twin.exchange.read.imported_robot import Findings

WORLD = "world"
"""Value of `root` that selects all robots of the file, which are then read as one mechanism."""


def choose_robot(model, path: Path, root: str | None, name: Callable[[str, int], str], findings: Findings) -> list[int]:
    """Return the numbers of the robot's bodies, the world first.

    `root` is the name of any body of the robot, or "world" for all bodies. None selects the only robot of the file.
    Mocap bodies are left out: a program moves them, and no joint does.

    Raises:
        SourceError: there are several robots and `root` is None, or the body does not exist.
    """
    candidates: list[int] = []
    for body in range(1, model.nbody):
        if model.body_mocapid[body] >= 0:
            text = f"body '{name('BODY', body)}' is a mocap body, which a program moves: it is left out."
            findings.warn("mocap", text, name("BODY", body))
        if not _is_mocap(model, body):
            candidates.append(body)
    if root == WORLD:
        return [0, *candidates]
    groups = _robot_groups(model)
    moving = [group for group in groups if _has_joint(model, group)]
    if root is None:
        robots = _driven_groups(model, moving) or moving
        if len(robots) > 1:
            tops = ", ".join(_title(group, name) for group in robots)
            raise UnsupportedError(
                f"{path}: the file has {len(robots)} robots: {tops}. Choose one with --root NAME, or read all as one "
                f"with --root {WORLD}."
            )
        if len(moving) <= 1:
            return [0, *candidates]
        chosen_group = robots[0]
    else:
        numbers = {name("BODY", body): body for body in candidates}
        if root not in numbers:
            raise SourceError(f"{path}: --root: {unknown('body', root, [*numbers, WORLD])}")
        chosen_group = next(group for group in groups if numbers[root] in group)
    chosen_bodies = set(chosen_group)
    for group in groups:
        if group is chosen_group:
            continue
        if root is None and group not in moving:
            chosen_bodies |= group  # without a choice, bodies that do not move are the surroundings of the only robot
            continue
        title = _title(group, name)
        text = f"body {title} and its children are left out: they do not belong to the robot."
        if group in moving:
            findings.warn("prop", text, title)
        else:
            findings.note("prop", text, title)
    return [0, *sorted(chosen_bodies)]


def _has_joint(model, group: set[int]) -> bool:
    return any(model.body_jntnum[body] for body in group)


def _driven_groups(model, groups: list[set[int]]) -> list[set[int]]:
    """Return the groups of bodies that an actuator moves."""
    driven_bodies: set[int] = set()
    for actuator in range(model.nu):
        driven_bodies |= _bodies_of_actuator(model, actuator)
    return [group for group in groups if group & driven_bodies]


def _is_mocap(model, body: int) -> bool:
    """Return whether a body is a mocap body or on one."""
    return bool(model.body_mocapid[model.body_rootid[body]] >= 0)


def tied_bodies(model, number: int) -> set[int]:
    """Return the numbers of the bodies, except the world, that the equality constraint `number` constrains."""
    import mujoco

    eq = mujoco.mjtEq
    kind = eq(int(model.eq_type[number]))
    ends = [int(model.eq_obj1id[number])]
    if model.eq_obj2id[number] >= 0:  # -1: nothing, or the world
        ends.append(int(model.eq_obj2id[number]))
    bodies: set[int] = set()
    for end in ends:
        if kind in (eq.mjEQ_CONNECT, eq.mjEQ_WELD):
            if int(model.eq_objtype[number]) == int(mujoco.mjtObj.mjOBJ_SITE):
                bodies.add(int(model.site_bodyid[end]))
            else:
                bodies.add(end)
        elif kind == eq.mjEQ_JOINT:
            bodies.add(int(model.jnt_bodyid[end]))
        elif kind == eq.mjEQ_TENDON:
            bodies |= _bodies_of_tendon(model, end)
    return bodies - {0}


def _bodies_of_tendon(model, tendon: int) -> set[int]:
    """Return the bodies that a tendon pulls."""
    import mujoco

    bodies = set()
    for wrap in range(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon]):
        target = int(model.wrap_objid[wrap])
        kind = int(model.wrap_type[wrap])
        if kind == int(mujoco.mjtWrap.mjWRAP_JOINT):
            bodies.add(int(model.jnt_bodyid[target]))
        elif kind == int(mujoco.mjtWrap.mjWRAP_SITE):
            bodies.add(int(model.site_bodyid[target]))
    return bodies


def _bodies_of_actuator(model, actuator: int) -> set[int]:
    """Return the bodies that an actuator moves."""
    import mujoco

    trn = mujoco.mjtTrn
    target = int(model.actuator_trnid[actuator, 0])
    kind = trn(int(model.actuator_trntype[actuator]))
    if kind in (trn.mjTRN_JOINT, trn.mjTRN_JOINTINPARENT):
        return {int(model.jnt_bodyid[target])}
    if kind == trn.mjTRN_TENDON:
        return _bodies_of_tendon(model, target)
    if kind == trn.mjTRN_SITE:
        return {int(model.site_bodyid[target])}
    return set()


def _robot_groups(model) -> list[set[int]]:
    """Return groups of body numbers: two kinematic trees that an equality or tendon connects are in the same group."""
    trees: dict[int, set[int]] = {}
    for body in range(1, model.nbody):
        if not _is_mocap(model, body):
            trees.setdefault(int(model.body_rootid[body]), set()).add(body)
    groups = list(trees.values())
    ties = [tied_bodies(model, equality) for equality in range(model.neq)]
    for tendon in range(model.ntendon):
        ties.append(_bodies_of_tendon(model, tendon) - {0})
    for tied in ties:
        connected = [group for group in groups if group & tied]
        if len(connected) > 1:
            groups = [group for group in groups if group not in connected]
            groups.append(set().union(*connected))
    return sorted(groups, key=min)


def _title(group: set[int], name: Callable[[str, int], str]) -> str:
    return f"'{name('BODY', min(group))}'"
