"""Group the bodies of an MJCF into robots. Top-level bodies that equalities or tendons connect belong to one robot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from twin.core.errors import SourceError, UnsupportedError, unknown
from twin.exchange.read.source import Findings

WORLD = "world"
"""Value of `root` that selects all robots of the file, which are then read as one mechanism."""


def chosen(m, path: Path, root: str | None, name: Callable[[str, int], str], findings: Findings) -> list[int]:
    """Return the numbers of the robot's bodies, the world first.

    `root` is the name of any body of the robot, or "world" for all bodies. None selects the only robot of the file.
    Mocap bodies are left out: a program moves them, and no joint does.

    Raises:
        SourceError: there are several robots and `root` is None, or the body does not exist.
    """
    for b in range(1, m.nbody):
        if m.body_mocapid[b] >= 0:
            text = f"body '{name('BODY', b)}' is a mocap body, which a program moves: it is left out."
            findings.warn("mocap", text, name("BODY", b))
    rest = [b for b in range(1, m.nbody) if not _mocap(m, b)]
    if root == WORLD:
        return [0, *rest]
    groups = _groups(m)
    moving = [group for group in groups if _has_joint(m, group)]
    if root is None:
        robots = _driven(m, moving) or moving
        if len(robots) > 1:
            tops = ", ".join(_title(group, name) for group in robots)
            raise UnsupportedError(
                f"{path}: the file has {len(robots)} robots: {tops}. Choose one with --root NAME, or read all as one "
                f"with --root {WORLD}."
            )
        if len(moving) <= 1:
            return [0, *rest]
        own = robots[0]
    else:
        known = {name("BODY", b): b for b in rest}
        if root not in known:
            raise SourceError(f"{path}: --root: {unknown('body', root, [*known, WORLD])}")
        own = next(group for group in groups if known[root] in group)
    kept = set(own)
    for group in groups:
        if group is own:
            continue
        if root is None and group not in moving:
            kept |= group  # without a choice, bodies that do not move are the surroundings of the only robot
            continue
        title = _title(group, name)
        text = f"body {title} and its children are left out: they do not belong to the robot."
        if group in moving:
            findings.warn("prop", text, title)
        else:
            findings.note("prop", text, title)
    return [0, *sorted(kept)]


def _has_joint(m, group: set[int]) -> bool:
    return any(m.body_jntnum[b] for b in group)


def _driven(m, groups: list[set[int]]) -> list[set[int]]:
    """Return the groups of bodies that an actuator moves."""
    moved: set[int] = set()
    for i in range(m.nu):
        moved |= _drives(m, i)
    return [group for group in groups if group & moved]


def _mocap(m, body: int) -> bool:
    """Return whether a body is a mocap body or on one."""
    return bool(m.body_mocapid[m.body_rootid[body]] >= 0)


def tied_by(m, i: int) -> set[int]:
    """Return the numbers of the bodies, except the world, that the equality constraint with number `i` constrains."""
    import mujoco

    eq = mujoco.mjtEq
    kind = eq(int(m.eq_type[i]))
    ends = [int(m.eq_obj1id[i])]
    if m.eq_obj2id[i] >= 0:  # -1: nothing, or the world
        ends.append(int(m.eq_obj2id[i]))
    bodies: set[int] = set()
    for end in ends:
        if kind in (eq.mjEQ_CONNECT, eq.mjEQ_WELD):
            site = int(m.eq_objtype[i]) == int(mujoco.mjtObj.mjOBJ_SITE)
            bodies.add(int(m.site_bodyid[end]) if site else end)
        elif kind == eq.mjEQ_JOINT:
            bodies.add(int(m.jnt_bodyid[end]))
        elif kind == eq.mjEQ_TENDON:
            bodies |= _tendon(m, end)
    return bodies - {0}


def _tendon(m, i: int) -> set[int]:
    """Return the bodies that a tendon pulls."""
    import mujoco

    out = set()
    for w in range(m.tendon_adr[i], m.tendon_adr[i] + m.tendon_num[i]):
        of = int(m.wrap_objid[w])
        kind = int(m.wrap_type[w])
        if kind == int(mujoco.mjtWrap.mjWRAP_JOINT):
            out.add(int(m.jnt_bodyid[of]))
        elif kind == int(mujoco.mjtWrap.mjWRAP_SITE):
            out.add(int(m.site_bodyid[of]))
    return out


def _drives(m, i: int) -> set[int]:
    """Return the bodies that an actuator moves."""
    import mujoco

    trn = mujoco.mjtTrn
    of = int(m.actuator_trnid[i, 0])
    kind = trn(int(m.actuator_trntype[i]))
    if kind in (trn.mjTRN_JOINT, trn.mjTRN_JOINTINPARENT):
        return {int(m.jnt_bodyid[of])}
    if kind == trn.mjTRN_TENDON:
        return _tendon(m, of)
    if kind == trn.mjTRN_SITE:
        return {int(m.site_bodyid[of])}
    return set()


def _groups(m) -> list[set[int]]:
    """Return groups of body numbers: two kinematic trees that an equality or tendon connects are in the same group."""
    trees: dict[int, set[int]] = {}
    for b in range(1, m.nbody):
        if not _mocap(m, b):
            trees.setdefault(int(m.body_rootid[b]), set()).add(b)
    groups = list(trees.values())
    links = [tied_by(m, i) for i in range(m.neq)]
    links += [_tendon(m, i) - {0} for i in range(m.ntendon)]
    for link in links:
        joined = [group for group in groups if group & link]
        if len(joined) > 1:
            groups = [group for group in groups if group not in joined]
            groups.append(set().union(*joined))
    return sorted(groups, key=min)


def _title(group: set[int], name: Callable[[str, int], str]) -> str:
    return f"'{name('BODY', min(group))}'"
