"""The audit compares what a certificate of a motion states of mechanism, path and pieces with the CAD and the plan."""

from __future__ import annotations

import json

import pytest

import twin
from twin.api.audited_motions import _compare_driven, _compare_joints
from twin.api.proof import motion_files
from twin.core.errors import TwinError
from twin.exchange.audit.motion_certificate import _require_tiles
from twin.proof.motion.linkage import Linkage
from twin.proof.motion_certificate import _mechanism


@pytest.fixture(scope="module")
def mechanism():
    """A mechanism with loops and couplings."""
    return twin.load("davinci_psm_si").mechanism


def other_base(data):
    data["base"] = data["tool"]["body"]


def other_tool(data):
    data["tool"]["frame"][0][3] += 1e-9


def other_tool_body(data):
    data["tool"]["body"] = data["base"]


def other_driven(data):
    data["driven"] = data["driven"][::-1]


def other_ratio(data):
    data["couplings"][0]["ratios"][0] *= 1 + 1e-9


def weaker_coupling(data):
    row = data["couplings"][0]
    row["ratios"] = [1e-9 * ratio for ratio in row["ratios"]]
    row["total"] *= 1e-9


def other_total(data):
    data["couplings"][0]["total"] += 1e-9


def other_coordinates(data):
    data["couplings"][0]["coordinates"] = data["couplings"][0]["coordinates"][::-1]


def no_coupling(data):
    data["couplings"] = []


def other_child(data):
    data["tree"][1]["child_in_joint"][0][3] += 1e-9


def no_number(data):
    data["tree"][1]["on_parent"][0][3] = float("nan")


def loop_in_tree(data):
    data["tree"].append(data["loops"].pop(0))


def compared(data, mechanism):
    _compare_joints(data, mechanism)
    _compare_driven(data, mechanism)


CHANGES = (
    other_base,
    other_tool,
    other_tool_body,
    other_driven,
    other_ratio,
    weaker_coupling,
    other_total,
    other_coordinates,
    no_coupling,
    other_child,
    no_number,
    loop_in_tree,
)


@pytest.mark.parametrize("change", CHANGES)
def test_another_mechanism_is_refused(mechanism, change):
    data = json.loads(json.dumps(_mechanism(mechanism, Linkage(mechanism))))
    compared(data, mechanism)
    change(data)
    with pytest.raises(TwinError, match="not"):
        compared(data, mechanism)


PIECES = ((0, 0.0, 0.5), (0, 0.5, 1.0), (1, 0.0, 1.0), (2, 0.0, 0.25), (2, 0.25, 1.0))


def test_pieces_that_tile_all_phases_are_accepted():
    _require_tiles(PIECES, 3)


@pytest.mark.parametrize("k", range(len(PIECES)))
def test_a_piece_that_is_left_out_is_named(k):
    with pytest.raises(ValueError, match="piece"):
        _require_tiles(PIECES[:k] + PIECES[k + 1 :], 3)


@pytest.mark.parametrize(
    "pieces", [(), ((0, 0.0, 0.0), *PIECES), (*PIECES, PIECES[0]), ((0, 0.0, 2.0), *PIECES[2:]), PIECES[::-1]]
)
def test_pieces_that_are_no_path_are_refused(pieces):
    with pytest.raises(ValueError, match="piece"):
        _require_tiles(pieces, 3)


@pytest.mark.parametrize(
    ("protocols", "files"),
    [
        (["table2"], ["motion-table2.json"]),
        (["../a/b", "..\\a b"], ["motion-___a_b.json", "motion-___a_b-2.json"]),
        (["a", "A", "a-2"], ["motion-a.json", "motion-A-2.json", "motion-a-2-2.json"]),
        (["x" * 300], [f"motion-{'x' * 100}.json"]),
    ],
)
def test_a_protocol_of_any_name_has_a_file_of_its_own(protocols, files):
    assert motion_files(protocols) == files
