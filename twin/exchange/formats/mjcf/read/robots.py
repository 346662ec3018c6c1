"""Group the bodies of an MJCF into robots. Top-level bodies that equalities or tendons connect belong to one robot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from twin.core.errors import SourceError, unknown
from twin.exchange.read.source import Findings, note, warning

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
    groups = _groups(m)
    moving = [g for g in groups if any(m.body_jntnum[b] for b in g)]
    driven = [g for g in moving if any(_drives(m, i) & g for i in range(m.nu))]
    if root is None:
        robots = driven or moving
        if len(robots) > 1:
            tops = ", ".join(_title(m, g, name) for g in robots)
            raise SourceError(
                f"{path}: the file has {len(robots)} robots: {tops}. Choose one with --root NAME, or read all as one "
                f"with --root {WORLD}."
            )
        if len(moving) <= 1:
            return [0, *rest]
        own = robots[0]
    elif root == WORLD:
        return [0, *rest]
    else:
        known = {name("BODY", b): b for b in rest}
        if root not in known:
            raise SourceError(f"{path}: --root: {unknown('body', root, [*known, WORLD])}")
        own = next(g for g in groups if known[root] in g)
    for group in groups:
        if group is own or (root is None and group not in moving):
            continue
        title = _title(m, group, name)
        tell = warning if group in moving else note
        findings.append(
            tell("prop", f"body {title} and its children are left out: they do not belong to the robot.", title)
        )
    still = set() if root is not None else {b for g in groups if g not in moving for b in g}
    return [0, *sorted(own | still)]


def _mocap(m, body: int) -> bool:
    """Return whether a body is a mocap body or on one."""
    return bool(m.body_mocapid[m.body_rootid[body]] >= 0)


def tied_by(m, i: int) -> set[int]:
    """Return the numbers of the bodies, except the world, that the equality constraint with number `i` constrains."""
    import mujoco

    kind, ends = mujoco.mjtEq(int(m.eq_type[i])), [int(m.eq_obj1id[i]), int(m.eq_obj2id[i])]
    if kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
        site = int(m.eq_objtype[i]) == int(mujoco.mjtObj.mjOBJ_SITE)
        out = {int(m.site_bodyid[e]) if site else e for e in ends}
    elif kind == mujoco.mjtEq.mjEQ_JOINT:
        out = {int(m.jnt_bodyid[e]) for e in ends if e >= 0}
    elif kind == mujoco.mjtEq.mjEQ_TENDON:
        out = set().union(*(_tendon(m, e) for e in ends if e >= 0))
    else:
        out = set()
    return out - {0}


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

    trn, of = mujoco.mjtTrn, int(m.actuator_trnid[i, 0])
    kind = trn(int(m.actuator_trntype[i]))
    if kind in (trn.mjTRN_JOINT, trn.mjTRN_JOINTINPARENT):
        return {int(m.jnt_bodyid[of])}
    if kind == trn.mjTRN_TENDON:
        return _tendon(m, of)
    return {int(m.site_bodyid[of])} if kind == trn.mjTRN_SITE else set()


def _groups(m) -> list[set[int]]:
    """Return groups of body numbers: two kinematic trees that an equality or tendon connects are in the same group."""
    groups: dict[int, set[int]] = {}
    for b in (b for b in range(1, m.nbody) if not _mocap(m, b)):
        groups.setdefault(int(m.body_rootid[b]), set()).add(b)
    out = list(groups.values())
    for link in [*(tied_by(m, i) for i in range(m.neq)), *(_tendon(m, i) - {0} for i in range(m.ntendon))]:
        joined = [g for g in out if g & link]
        if len(joined) > 1:
            out = [g for g in out if g not in joined]
            out.append(set().union(*joined))
    return sorted(out, key=min)


def _title(m, group: set[int], name: Callable[[str, int], str]) -> str:
    return f"'{name('BODY', min(group))}'"
