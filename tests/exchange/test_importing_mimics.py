"""Mimic joints between hinges and slides: the ratio is in m/rad or rad/m, in every format of twin."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from twin.cad.description import load
from twin.cli import main
from twin.exchange.read import read
from twin.reference import ReferenceModel

AXES = {"revolute": (0, 1, 0), "prismatic": (1, 0, 0)}


def drawn(rng):
    """Return the text of a URDF of three joints of drawn kinds, each of the last two a mimic, and (ratio, offset)."""
    kinds = [str(k) for k in rng.choice(list(AXES), 3)]
    mimics = [(float(rng.uniform(0.05, 2) * rng.choice([-1, 1])), float(rng.uniform(-0.3, 0.3))) for _ in range(2)]
    inertial = (
        '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    rows = [f'<link name="l0">{inertial}</link>']
    for k, kind in enumerate(kinds):
        x, y, z = rng.uniform(-0.3, 0.3, 3)
        follows = ""
        if k:
            ratio, offset = mimics[k - 1]
            follows = f'<mimic joint="j{k - 1}" multiplier="{ratio!r}" offset="{offset!r}"/>'
        rows.append(
            f'<link name="l{k + 1}">{inertial}</link><joint name="j{k}" type="{kind}"><parent link="l{k}"/>'
            f'<child link="l{k + 1}"/><origin xyz="{x} {y} {z}" rpy="{z} {x} {y}"/>'
            f'<axis xyz="{" ".join(map(str, AXES[kind]))}"/><limit lower="-9" upper="9" effort="10" velocity="2"/>'
            f"{follows}</joint>"
        )
    return f'<robot name="r">{"".join(rows)}</robot>', kinds, mimics


def test_mimics_of_all_kinds_move_as_pinocchio_reads_them(tmp_path, rng):
    """The poses of 60 drawn robots, against Pinocchio's own reader at joint values by the definition of a mimic."""
    seen = set()
    for _ in range(60):
        text, kinds, mimics = drawn(rng)
        seen.add(tuple(kinds))
        (tmp_path / "r.urdf").write_text(text)
        mechanism = read(tmp_path / "r.urdf").mechanism
        other = pin.buildModelFromXML(text)
        data = other.createData()
        reference = ReferenceModel(mechanism)
        for q0 in rng.uniform(-0.8, 0.8, 3):
            values = [q0]
            for ratio, offset in mimics:
                values.append(ratio * values[-1] + offset)
            solved = reference.solve(np.array([q0]))
            np.testing.assert_allclose([solved.q_full[f"j{k}"] for k in range(3)], values, atol=1e-10)
            pin.framesForwardKinematics(other, data, np.array(values))
            for k in range(4):
                wanted = data.oMf[other.getFrameId(f"l{k}")].homogeneous
                np.testing.assert_allclose(solved.link_poses[f"l{k}"], wanted, atol=1e-9)
    assert len(seen) == 8


@pytest.mark.slow
def test_a_robot_with_mixed_mimics_is_exported_and_audited(tmp_path, rng, capsys):
    text, kinds, _ = drawn(rng)
    while len(set(kinds)) == 1:
        text, kinds, _ = drawn(rng)
    (tmp_path / "r.urdf").write_text(text)
    assert main(["new", "mixed", "--from", str(tmp_path / "r.urdf"), "--out", str(tmp_path / "mixed")]) == 0
    assert load(tmp_path / "mixed/cad/mixed.toml").coupling
    assert main(["export", str(tmp_path / "mixed"), "--out", str(tmp_path / "out")]) == 0
    assert main(["audit", str(tmp_path / "out")]) == 0
    mechanism = read(tmp_path / "r.urdf").mechanism
    for name in ("mixed.urdf", "mixed.xml"):
        back = read(tmp_path / "out" / name).mechanism
        for q0 in (-0.3, 0.4):
            wanted = ReferenceModel(mechanism).solve(np.array([q0])).q_full
            got = ReferenceModel(back).solve(np.array([q0])).q_full
            assert [got[j] for j in wanted] == pytest.approx(list(wanted.values()), abs=1e-8)
