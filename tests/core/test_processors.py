"""The number of processors that parallel work may use."""

from __future__ import annotations

import os

import pytest

from twin.core.errors import TwinError
from twin.core.jobs import PROCESSORS, usable_processors


@pytest.fixture(autouse=True)
def asked_anew():
    usable_processors.cache_clear()
    yield
    usable_processors.cache_clear()


def test_all_that_the_system_grants_unless_it_is_said(monkeypatch):
    monkeypatch.delenv(PROCESSORS, raising=False)
    assert usable_processors() == len(os.sched_getaffinity(0))


def test_the_environment_sets_a_limit_and_grants_none(monkeypatch):
    monkeypatch.setenv(PROCESSORS, "1")
    assert usable_processors() == 1
    usable_processors.cache_clear()
    monkeypatch.setenv(PROCESSORS, "100000")
    assert usable_processors() == len(os.sched_getaffinity(0))


@pytest.mark.parametrize("value", ["0", "-1", "two", "1.5", "²"])
def test_error_names_the_variable_and_its_value(value, monkeypatch):
    monkeypatch.setenv(PROCESSORS, value)
    with pytest.raises(TwinError, match=PROCESSORS) as caught:
        usable_processors()
    assert value in str(caught.value)
