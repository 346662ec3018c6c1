"""A short run of the fuzzer of the text readers, and that it would notice a crash, a hang and a death."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

import fuzz_readers as fuzz
from twin.core.errors import SourceError

HERE = Path(__file__).parents[1]
READERS = sorted(fuzz.readers())


@pytest.mark.slow
@pytest.mark.parametrize("name", READERS)
def test_nothing_but_a_twin_error_comes_out_of_damaged_text(name):
    result = fuzz.run(name, 60, seed=1)
    assert not result.crashes, [(i, what[-500:]) for i, what, _ in result.crashes]
    assert sum(result.ends.values()) == 60
    assert result.ends["refused"] > 20


@pytest.mark.nightly
@pytest.mark.parametrize("name", READERS)
def test_nothing_but_a_twin_error_comes_out_of_much_damaged_text(name):
    result = fuzz.run(name, 1000, seed=2)
    assert not result.crashes, [(i, what[-500:]) for i, what, _ in result.crashes]


@pytest.mark.slow
def test_what_must_not_happen_is_noticed(monkeypatch):
    good = fuzz.readers()["closures"]
    seed = good.seeds[0].read_bytes()

    def kind_of(text):
        return 4 if text == seed else sum(text) % 5

    def reader(path, on):
        kind = kind_of(path.read_bytes())
        if kind == 0:
            raise KeyError("crash")
        if kind == 1:
            while True:
                pass
        if kind == 2:
            os.kill(os.getpid(), signal.SIGKILL)
        if kind == 3:
            raise SourceError("x: fine")

    monkeypatch.setattr(fuzz, "readers", lambda: {"bad": fuzz.Reader(good.seeds, "x.yaml", reader)})
    monkeypatch.setattr(fuzz, "HANG", 0.2)
    result = fuzz.run("bad", 30)
    kinds = [kind_of(data) for data, _ in zip(fuzz.inputs("bad", 0), range(30), strict=False)]
    assert len(result.crashes) == sum(k in (0, 1, 2) for k in kinds)
    for i, what, data in result.crashes:
        wanted = {0: "KeyError: 'crash'", 1: "not done after 0.2 s", 2: "the process ended with -9"}[kinds[i]]
        assert wanted in what
        assert sum(data) % 5 == kinds[i]
