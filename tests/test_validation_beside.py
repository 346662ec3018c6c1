"""A function in a second process: answers, errors, death."""

from __future__ import annotations

import os
import time

import numpy as np
import pytest

from twin import assets
from twin.errors import TwinError
from twin.validation.beside import Beside


def test_the_answer_comes_back():
    with Beside(np.linalg.norm, np.array([3.0, 4.0])) as task:
        assert task.result() == 5.0


def test_an_error_of_ours_is_raised_here():
    with Beside(assets.files, "sill") as task, pytest.raises(TwinError, match="there is no robot 'sill'"):
        task.result()


def test_a_process_that_dies_is_told_with_its_last_words():
    with Beside(os._exit, 3) as task, pytest.raises(TwinError, match="a second process died"):
        task.result()
    with Beside(np.linalg.inv, "no matrix") as task, pytest.raises(TwinError, match="LinAlgError"):
        task.result()


def test_leaving_ends_it():
    start = time.monotonic()
    with Beside(time.sleep, 60) as task:
        pass
    assert task._process.returncode is not None
    assert time.monotonic() - start < 30
