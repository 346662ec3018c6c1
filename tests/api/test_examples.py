"""The example in the docstring of each public function runs, and gives what it shows."""

from __future__ import annotations

import doctest
import inspect

import pytest

import twin

METHODS = ("forward", "inverse", "jacobian")
"""Methods of a robot that people call first."""


def examples():
    """Return {name: docstring of a public function or method}."""
    found = {}
    for name in twin.__all__:
        member = getattr(twin, name)
        if inspect.isfunction(member):
            found[name] = inspect.getdoc(member)
    for name in METHODS:
        found[f"Robot.{name}"] = inspect.getdoc(getattr(twin.Robot, name))
    return found


EXAMPLES = examples()


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_public_function_has_an_example(name):
    """The example loads twin, calls the function, and shows an answer."""
    steps = doctest.DocTestParser().get_examples(EXAMPLES[name])
    assert any(step.source.strip() == "import twin" for step in steps)
    call = name.rpartition(".")[2] + "("
    assert any(call in step.source for step in steps)
    assert any(step.want for step in steps)


LONG = ("operate_procedure", "replay_procedure")
"""Names whose examples take more than half a minute."""


def lanes():
    """Return the names for `parametrize`; those of long examples are nightly."""
    return [pytest.param(name, marks=[pytest.mark.nightly] if name in LONG else []) for name in EXAMPLES]


@pytest.mark.slow
@pytest.mark.parametrize("name", lanes())
def test_examples_show_what_they_give(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    example = doctest.DocTestParser().get_doctest(EXAMPLES[name], {}, name, None, 0)
    said = []
    failed, tried = doctest.DocTestRunner().run(example, out=said.append)
    assert tried > 0
    assert failed == 0, "".join(said)
