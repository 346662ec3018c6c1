"""A reader of a stream of `twin serve`: what it says about a server that sends something else."""

from __future__ import annotations

import contextlib

import pytest

from twin.ui.headset import watched
from twin.ui.headset.watched import Watched


@pytest.mark.parametrize("text", ["not JSON", "[1]"])
def test_a_text_that_is_no_document_is_a_problem_and_the_reader_connects_again(monkeypatch, text):
    class Socket:
        def recv(self, timeout):
            return text

    about = {"name": "s", "model_hash": "h", "robots": [], "fields": []}
    tries = []
    monkeypatch.setattr(watched.threading.Thread, "start", lambda thread: None)
    monkeypatch.setattr(Watched, "_about", lambda self: about)
    reader = Watched(1, "s")

    def connect(*args, **options):
        tries.append(1)
        if len(tries) == 2:
            reader.close()
        return contextlib.nullcontext(Socket())

    monkeypatch.setattr(watched, "connect", connect)
    monkeypatch.setattr(watched, "_PAUSE", 0.0)
    reader._read()
    assert len(tries) == 2
    assert "no valid document" in reader.problem
