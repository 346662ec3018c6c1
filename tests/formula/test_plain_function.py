"""Plain formula files with one mistake each: the message says at which line, what, and the way out (first line)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from twin.core.errors import KinematicsError
from twin.kinematics import compile_formula
from twin.robots import load_formula

FILES = sorted((Path(__file__).parents[1] / "data/bad/formula").glob("error_*.py"))


def driven():
    return [("q1", False), ("q2", False)], np.eye(4), None


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_error_files_say_what_is_wrong_and_where(path):
    with pytest.raises(KinematicsError) as caught:
        compile_formula(load_formula(path, driven=driven))
    line, text = re.fullmatch(r"# (?:(\d+): )?(.*)", path.read_text().splitlines()[0]).groups()
    message = str(caught.value)
    assert text in message
    assert message.startswith(f"{path}:{line}: " if line else f"{path}: ")


def test_there_are_many_of_them():
    assert len(FILES) >= 12


def test_no_value_at_a_pose_names_the_line(tmp_path):
    (tmp_path / "formula.py").write_text(
        "import numpy as np\n\n\ndef inverse(pose):\n    h = np.sqrt(0.01 - pose[0, 3] ** 2)\n    return h, h\n"
    )
    kin = compile_formula(load_formula(tmp_path, driven=driven))
    T = np.eye(4)
    np.testing.assert_allclose(kin.inverse(T), [0.1, 0.1])
    T[0, 3] = 0.2
    with pytest.raises(KinematicsError, match=r"formula\.py:5: inverse\(\): invalid value encountered in sqrt"):
        kin.inverse(T)


def test_plain_file_alone_does_not_know_its_joints(tmp_path):
    (tmp_path / "formula.py").write_text("def inverse(pose):\n    return pose[0, 3]\n")
    with pytest.raises(KinematicsError, match="load the robot, not the file"):
        load_formula(tmp_path)
