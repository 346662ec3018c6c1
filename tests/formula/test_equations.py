"""Equations noted at their functions: what a variant changes runs among the rows that it leaves, each in its place."""

from __future__ import annotations

import inspect
import textwrap

import pytest

from twin.core.errors import KinematicsError
from twin.formula.variant_rows import equation_rows
from twin.robots import load_formula, names
from twin.validation.explain.function_source import Source

HEAD = '''
from twin.formula.contract import *
from twin.formula.equations import Equations

equation = Equations()

@equation("inverse", "x, y -> q", gives="q p", why="as it is")
def two(x, y, l):
    """Two rows."""
    far = x + l
    q = 2 * far + q0(y)
    p = q - y
    return q, p

def q0(y):
    return 10 * y
'''


@pytest.fixture
def module(tmp_path):
    """A function that runs a file with more text after `HEAD`; it returns the file's names."""

    def run(text):
        path = tmp_path / "rows.py"
        path.write_text(HEAD + textwrap.dedent(text))
        space = {"__name__": "rows"}
        exec(compile(path.read_text(), str(path), "exec"), space)
        return space

    return run


@pytest.fixture
def changed(module):
    return module('''
        @equation.variant("near", of=two, why="the length is subtracted")
        def near(x, y, l, k):
            """As drawn."""
            half = k * y
            q = 2 * (x - l) + half
            return q

        @equation.variant("nearer", of=near, why="and p is turned")
        def nearer(q, y):
            p = y - q
            return p
        ''')


def test_a_variant_runs_its_rows_among_those_that_it_leaves(changed):
    (e,) = changed["equation"]
    assert (list(e.variants), e.default) == (["corrected", "near", "nearer"], "corrected")
    assert e.reasons == {
        "corrected": "as it is",
        "near": "the length is subtracted",
        "nearer": "and p is turned",
    }
    assert e.variants["corrected"](3, 5, 1) == (58, 53)
    assert e.variants["near"](3, 5, 1, k=100) == (504, 499)
    assert e.variants["nearer"](3, 5, 1, k=100) == (504, -499)
    for f in e.variants.values():
        assert inspect.unwrap(f).__globals__ is changed
        assert set(inspect.signature(f).parameters) == {"x", "y", "l"} | ({"k"} if f is not changed["two"] else set())


def test_each_row_of_a_variant_is_where_it_stands_in_the_file(changed):
    for name, homes in {"near": "two near near two two", "nearer": "two near near nearer two"}.items():
        f = changed[name]
        source = Source(f)
        assert [r.definition.name for r in equation_rows(f)] == homes.split()
        for row, s in zip(equation_rows(f), source.statements, strict=True):
            line = source.data.decode().splitlines()[s.line - 1].strip()
            assert source.text(s.start, s.end) == line
            assert row.definition.lineno < s.line <= (row.definition.end_lineno or 0)


def test_an_argument_that_a_variant_changes_is_changed_before_all_rows(module):
    f = module('''
        @equation.variant("behind", of=two, why="the length is drawn the other way")
        def behind(l):
            """As drawn."""
            l = -l
            return l
        ''')["behind"]
    assert f(3, 5, 1) == (54, 49)
    assert [r.definition.name for r in equation_rows(f)] == ["behind", "two", "two", "two", "two"]


def test_an_error_in_a_row_that_a_variant_leaves_names_its_line(changed):
    with pytest.raises(TypeError) as error:
        changed["near"](3, None, 1, k=0 * 1j)
    assert error.traceback[-1].lineno + 1 == next(s.line for s in Source(changed["near"]).statements if s.new)


def test_what_only_a_variant_reads_is_offered_to_no_other_row(changed):
    source = Source(changed["near"])
    _, _, q, p, _ = source.statements
    assert source.names_at(q) == ({"x", "y", "l", "k", "far", "half"}, {"x", "y", "l", "k", "half"})
    assert source.names_at(p) == ({"x", "y", "l", "far", "q"}, {"x", "y", "l", "far", "q"})


BAD = {
    "a symbol without a row": ("z = 1", "z", "must end by returning the symbols that it changes"),
    "a statement that is not a row": ("q += 1", "q", "its rows must be assignments"),
    "a part of what it changes": ("q = 1\n    p = 2", "q", "return q, p"),
    "nothing returned": ("q = 1", "", "return q"),
    "half of a row": ("q, far = 1, 2", "q, far", "0 rows of the equation assign exactly these symbols, not one row"),
}


@pytest.mark.parametrize(("text", "back", "told"), BAD.values(), ids=BAD)
def test_a_variant_that_changes_no_row_is_refused(module, text, back, told):
    head = f'@equation.variant("bad", of=two, why="none")\ndef bad(q):\n    {text}\n'
    space = module(head + (f"    return {back}\n" if back else "    return\n"))
    with pytest.raises(KinematicsError, match=r"rows\.py:\d+: bad\(\)") as error:
        inspect.signature(space["bad"])
    assert told in str(error.value)


def test_a_variant_that_is_only_a_docstring_is_refused(module):
    space = module('''
        @equation.variant("bad", of=two, why="none")
        def bad(q):
            """As printed."""
        ''')
    with pytest.raises(KinematicsError, match=r"rows\.py:\d+: bad\(\) has no rows: assign the symbols"):
        inspect.signature(space["bad"])


def test_a_variant_of_what_is_no_equation_and_a_name_given_twice_are_refused(module):
    with pytest.raises(KinematicsError, match="not an equation of this file"):
        module('@equation.variant("bad", of=q0, why="none")\ndef bad(y):\n    return y\n')
    with pytest.raises(KinematicsError, match="two equations are named 'two'"):
        module('@equation("forward", "again", gives="q", name="two")\ndef bad(y):\n    return y\n')


@pytest.mark.parametrize("name", ["near", "corrected"])
def test_a_second_variant_of_the_same_name_is_refused(module, name):
    with pytest.raises(KinematicsError, match=f"two variants of equation 'two' are named '{name}'"):
        module(
            f"""
        @equation.variant("near", of=two, why="first")
        def first(q):
            q = -q
            return q

        @equation.variant("{name}", of=two, why="second")
        def second(q):
            q = 2 * q
            return q
        """
        )


@pytest.mark.parametrize("robot", names())
def test_rows_that_equal_what_they_change_are_not_repeated(robot):
    """A variant of a built-in robot states what differs, no more."""
    for e in load_formula(robot).equations:
        left = [Source(f) for v, f in e.variants.items() if v != e.default]
        base = Source(e.variants[e.default])
        texts = {base.text(s.start, s.end) for s in base.statements}
        for source in left:
            assert source.node is not base.node
            own = [s for s in source.statements if s.home is source.node]
            assert own
            assert not [s for s in own if source.text(s.start, s.end) in texts]
