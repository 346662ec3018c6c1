"""Singular states: told, left by the solver, and not chosen for home where there is a better one."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import twin
from made.lanes import nightly
from twin import cli
from twin.core.errors import AssemblyError
from twin.exchange.read import read
from twin.exchange.read.loop_closing import close
from twin.reference import ReferenceModel
from twin.reference import regularity as regularity_module
from twin.reference.regularity import regularity
from twin.reference.singular_departure import limit_excess

KNEES = Path(__file__).parents[1] / "data/regular/knees.xml"
SIT = '<keyframe><key name="sit" qpos="-0.1 0.505 -1.011 -0.2 0.72 -1.44"/></keyframe>'


@pytest.fixture(scope="module")
def drawn():
    """Knees stretched, as the file has them."""
    return ReferenceModel(read(KNEES, root="world", guarded=False).mechanism)


def with_key(tmp_path, text=SIT):
    path = tmp_path / "knees.xml"
    path.write_text(KNEES.read_text().replace("<!--KEY-->", text))
    return path


def test_stretched_knees_are_singular_and_the_robots_are_not(drawn):
    found = regularity(drawn, [drawn.home().x])[0]
    assert (found.rank, found.usual, found.singular) == (2, 4, True)
    for name in twin.names():
        model = twin.load(name).reference()
        assert not regularity(model, [model.home().x])[0].singular


@pytest.mark.parametrize("value", [0.0, 1e-17])
def test_a_jacobian_that_vanishes_is_singular(monkeypatch, value):
    values = {0: np.full(2, value), 1: np.ones(2)}
    monkeypatch.setattr(regularity_module, "closed_beside", lambda model, x: [1])
    monkeypatch.setattr(regularity_module, "_values", lambda model, x: values[x])
    found = regularity(None, [0])[0]
    assert (found.rank, found.usual, found.margin, found.singular) == (0, 2, 0, True)


@pytest.mark.slow
@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("step", nightly([-1e-4, -0.005, -0.02, -0.1, -0.3], every=3))
def test_a_walk_leaves_a_singular_start_within_the_limits(drawn, joint, step):
    q = step * (np.arange(2) == joint)
    state = drawn.solve(q)
    assert state.worst_gap < 1e-9
    assert limit_excess(drawn.tree, state.x) < 1e-9  # the knee bends to the side on which it may
    if step < -1e-3:  # along samples a gap of less than a millimetre counts as closed
        run = drawn.run(np.linspace(0, 1, 50)[:, None] * q)
        assert run.gaps[..., 0].max() < 1e-3
        assert run.gaps[-1, :, 0].max() < 1e-9


def test_what_no_way_leads_to_is_still_refused(drawn):
    with pytest.raises(AssemblyError):
        drawn.solve(np.array([0.05, 0.0]))  # legs do not stretch beyond their length


def test_home_is_a_regular_state_beside_a_singular_one(drawn):
    imported = close(read(KNEES, root="world", guarded=False))
    assert [f.code for f in imported.findings if f.code in ("import.home", "import.singular")] == ["import.home"]
    model = ReferenceModel(imported.mechanism)
    home = model.home()
    assert home.worst_gap < 1e-9
    assert regularity(model, [home.x])[0].margin > 0.05
    assert limit_excess(model.tree, home.x) < 1e-6
    for i in range(2):
        for step in (-0.02, -0.005, 0.005):
            model.solve(home.q + step * (np.arange(2) == i), home)


def test_a_key_frame_is_preferred_and_every_key_frame_is_reached(drawn, tmp_path):
    keys = SIT.replace("</keyframe>", '<key name="squat" qpos="-0.3 0.9 -1.8 -0.3 0.9 -1.8"/></keyframe>')
    imported = close(read(with_key(tmp_path, keys), root="world", guarded=False))
    (said,) = [f.message for f in imported.findings if f.code == "import.home"]
    assert "key frame 'sit'" in said
    model = ReferenceModel(imported.mechanism)
    np.testing.assert_allclose(model.home().q, [-0.1, -0.2], atol=1e-6)
    for name in imported.mechanism.postures:
        assert model.solve(imported.mechanism.posture(name)).worst_gap < 1e-9


def test_a_regular_robot_rests_as_it_is_drawn():
    path = Path(__file__).parents[1] / "data/importing/models/fourbar.xml"
    assert not [f for f in close(read(path, guarded=False)).findings if f.code == "import.home"]


def test_info_warns_of_a_singular_home_and_new_does_not_pick_it(drawn, tmp_path, capsys):
    folder = tmp_path / "own"
    assert cli.main(["new", "own", "--from", str(KNEES), "--root", "world", "--out", str(folder), "--quiet"]) == 0
    capsys.readouterr()
    assert cli.main(["info", str(folder), "--json"]) == 0
    assert "home.singular" not in capsys.readouterr().out
    from twin.exchange.read.description_text import describe

    (folder / "cad/own.toml").write_text(
        describe(replace(drawn.mechanism, name="own"), "knees.xml")
    )  # as the file has it
    assert cli.main(["info", str(folder), "--json"]) == 0
    (told,) = [f for f in json.loads(capsys.readouterr().out)["findings"] if f["code"] == "home.singular"]
    assert "rank of the loop Jacobian 2, in nearby poses 4" in told["message"]
