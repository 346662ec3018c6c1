"""Expressions are counterparts only if attributes, keywords and parts are the same; numbers keep their text."""

from __future__ import annotations

import importlib.util

import pytest

from made.explain_seeds import WHOLE_ELSEWHERE, misprinted
from twin.validation.explain.counterparts import counterpart_edits
from twin.validation.explain.function_source import Source
from twin.validation.explain.row_deviations import Judge


def edits(folder, *statements):
    """Return (old, new) of the edits of the first statement of a function."""
    path = folder / "equations.py"
    lines = "".join(f"    {statement}\n" for statement in statements)
    path.write_text(f"def equations(a, b, c, p, q, r, s, foo):\n{lines}    return u\n")
    spec = importlib.util.spec_from_file_location("equations", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    source = Source(module.equations)
    return [(edit.old, edit.new) for edit in counterpart_edits(source, source.statements[0])]


@pytest.mark.parametrize(
    ("short", "long", "expected"),
    [
        ("a.x + b * c", "p.x + q * c * r", None),
        ("a.x + b * c", "p.y + q * c * s", ()),
        ("foo(a, key=b) * c", "foo(p, key=q) * r * s", None),
        ("foo(a, key=b) * c", "foo(p, other=q) * r * s", ()),
        ("a[:2] + b * c", "p[2:] + q * r * s", ()),
    ],
)
def test_attributes_keywords_and_parts_are_compared(tmp_path, short, long, expected):
    found = edits(tmp_path, f"u = {short}", f"v = {long}")
    assert (found == []) == (expected == ())


def test_a_number_keeps_its_text_and_a_keyword_its_name(tmp_path):
    found = edits(tmp_path, "u = a * 1e5 + b * c", "v = p * 1e5 + q * r * foo(s, a=0x10, p=2.50)")
    assert "(b * c * foo(s, a=0x10, p=2.50))" in [new for _, new in found]


def test_the_module_of_a_function_is_no_variable(tmp_path):
    found = edits(tmp_path, "u = a + b * c", "v = p + q * r * foo.fabs(s)")
    assert "(b * c * foo.fabs(s))" in [new for _, new in found]


def test_a_function_in_the_missing_part_leaves_no_wrong_names(tmp_path):
    found = edits(tmp_path, "u = a + b * c", "v = p + q * r * foo(lambda x: x * s)")
    assert not any("lambda" in new for _, new in found)


def test_a_part_that_stands_whole_elsewhere_is_put_back(tmp_path):
    case, formula = misprinted("sher", *WHOLE_ELSEWHERE, tmp_path)
    source = Judge(formula, None, case.reference).step("tilt_inverse").source
    assert ("phi4", "(theta - pi / 2 + phi4)") in [
        (e.old, e.new) for e in counterpart_edits(source, source.statements[0])
    ]
