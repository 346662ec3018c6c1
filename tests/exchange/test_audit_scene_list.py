"""The list of robots in scene.json: entries that cannot be used are named."""

from __future__ import annotations

import json

import numpy as np
import pytest

from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.scene_folder import _robots, _scene_data


def entry(name: str) -> dict:
    return {"name": name, "protocol": "", "T_world_base": np.eye(4).tolist(), "folder": name}


def test_two_robots_of_one_name_are_found(tmp_path):
    """The poses of the second replaced those of the first, which was compared with nothing."""
    (tmp_path / "arm").mkdir()
    ledger = Ledger("scene.json")
    robots = list(_robots(tmp_path, {"robots": [entry("arm"), entry("arm")]}, ledger))
    assert [robot.name for robot in robots] == ["arm"]
    assert [finding.code for finding in ledger.findings] == ["scene.robots"]


@pytest.mark.parametrize("content", ["[]", "3", "{", '{"robots": 3}', "{}"])
def test_a_list_that_is_none_is_found_once(tmp_path, content):
    file = tmp_path / "scene.json"
    file.write_text(content)
    ledger = Ledger("scene.json")
    assert list(_robots(tmp_path, _scene_data(file, ledger), ledger)) == []
    assert [finding.code for finding in ledger.findings] == ["scene.unreadable"]
    assert json.dumps(ledger.findings[0].as_dict())
