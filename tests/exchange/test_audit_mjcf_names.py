"""Joints without names, and shapes of an MJCF that a body has twice or that collide otherwise, are reported."""

from __future__ import annotations

import pytest

from twin.exchange.audit.ledger import Ledger
from twin.exchange.formats.mjcf.audit import read_mujoco
from twin.exchange.formats.mjcf.audit.model_checks import check_model

GEOM = '<geom type="mesh" mesh="tip" contype="1" conaffinity="1"/>'


def model(third_joint: str = 'name="q2"', third_geoms: str = GEOM) -> str:
    """Return an MJCF of four turning bodies with one mesh each; that of the third has other attributes and shapes."""
    bodies = []
    for i in range(4):
        joint = third_joint if i == 2 else f'name="q{i}"'
        geoms = third_geoms if i == 2 else GEOM
        bodies.append(f'<body name="b{i}" pos="{i} 0 0"><joint {joint} type="hinge" axis="0 0 1"/>{geoms}</body>')
    mesh = '<mesh name="tip" vertex="0 0 0  0.1 0 0  0 0.1 0  0 0 0.1"/>'
    return f"<mujoco><asset>{mesh}</asset><worldbody>{''.join(bodies)}</worldbody></mujoco>"


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (model(), None),
        (model(third_joint=""), "mjcf.unnamed"),
        (model(third_geoms=2 * GEOM), "mjcf.repeated"),
        (model(third_geoms=GEOM.replace('conaffinity="1"', 'conaffinity="2"')), "mjcf.collider"),
    ],
    ids=["right", "unnamed", "repeated", "collider"],
)
def test_an_element_unlike_the_others_is_told(text, code, tmp_path):
    path = tmp_path / "four.xml"
    path.write_text(text)
    ledger = Ledger("four.xml")
    check_model(read_mujoco(path, ledger).model, ledger)
    told = [(f.code, f.where) for f in ledger.found if f.code in ("mjcf.unnamed", "mjcf.repeated", "mjcf.collider")]
    assert told == ([] if code is None else [(code, "four.xml: b2")])
