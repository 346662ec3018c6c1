import math

"""The machinery that reads TOML written by people."""

import tomllib
from typing import Annotated, Literal

import pytest
import tomlkit
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import Field, model_validator

from twin.core.errors import DescriptionError
from twin.model.contact import ObjectTable
from twin.model.scene import ProtocolSource
from twin.planning.protocol.phase_table import JointKey
from twin.planning.protocol.phases.samples import SamplesTable
from twin.schema import Identifier, LimitRange, Range, Table, Vector, at, error_at, key_lines, load_toml, parse_toml


class Slide(Table):
    type: Literal["slide"]
    lower_mm: float
    upper_mm: float


class Hinge(Table):
    type: Literal["hinge"]
    lower_deg: Annotated[float, Field(ge=-360)]
    upper_deg: Annotated[float, Field(le=360)]
    axis: Vector = (0.0, 0.0, 1.0)


class Robot(Table):
    name: Identifier
    mass_kg: Annotated[float, Field(gt=0)] = 1.0
    teeth: int = 3
    fixed: bool = False
    travel_mm: Range = (0.0, 1.0)
    limits_mm: LimitRange | None = None
    ratio: float | list[float] = 1.0
    joints: dict[Identifier, Annotated[Slide | Hinge, Field(discriminator="type")]] = {}  # noqa: RUF012
    points: list[Vector] = []  # noqa: RUF012
    speed_mm_s: float | None = None

    @model_validator(mode="after")
    def _teeth_fit(self):
        if self.teeth == 13:
            raise at("teeth", "thirteen teeth do not fit")
        return self


def message(text: str) -> str:
    with pytest.raises(DescriptionError) as caught:
        parse_toml(text, Robot, "r.toml")
    return str(caught.value)


def test_a_right_file_is_read():
    robot = parse_toml('name = "a"\nmass_kg = 2\njoints.q1 = { type = "slide", lower_mm = 0, upper_mm = 5 }\n', Robot)
    assert robot.mass_kg == 2.0
    assert isinstance(robot.joints["q1"], Slide)
    assert robot.travel_mm == (0.0, 1.0)


def test_one_of_two_limits_may_be_infinite():
    assert parse_toml('name = "a"\nlimits_mm = [-inf, 3]', Robot).limits_mm == (-math.inf, 3.0)
    assert parse_toml('name = "a"\nlimits_mm = [-2, inf]', Robot).limits_mm == (-2.0, math.inf)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('name = "a"\njoints.q1 = { type = { slide = 1 } }', "r.toml:2: joints.q1: unknown type"),
        ('name = "a"\njoints.q1 = { type = ["slide"] }', "r.toml:2: joints.q1: unknown type"),
        ("", "r.toml:1: name: this key is missing; its value must be text"),
        ('name = "a"\nmass = 2', "r.toml:2: mass: the unit is missing: write mass_kg"),
        ('name = "a"\nmass_g = 2', "r.toml:2: mass_g: the unit is kg here: write mass_kg"),
        ('name = "a"\nspeed_m_s = 2', "r.toml:2: speed_m_s: the unit is mm/s here: write speed_mm_s"),
        ('nam = "a"', "r.toml:1: nam: unknown key; did you mean name?; known keys: fixed, joints, "),
        (
            'name = "a"\nmass_kg = "2"',
            'r.toml:2: mass_kg = "2": a number is expected, not text; allowed: a numb',
        ),
        (
            'name = "a"\nmass_kg = -1',
            "r.toml:2: mass_kg = -1: out of range; allowed: a number > 0",
        ),
        (
            'name = "a"\nmass_kg = nan',
            "r.toml:2: mass_kg = NaN: must be a finite number; allowed: a number > 0",
        ),
        ('name = "a"\nmass_kg = true', "r.toml:2: mass_kg = true: a number is expected, not true or false"),
        ('name = "a"\nteeth = 2.5', "r.toml:2: teeth = 2.5: a whole number is expected, not a number"),
        ('name = "a"\nteeth = 13', "r.toml:2: teeth = 13: thirteen teeth do not fit"),
        ('name = "a"\nfixed = 1', "r.toml:2: fixed = 1: true or false is expected, not a number"),
        ('name = "a"\nfixed = "no"', 'r.toml:2: fixed = "no": true or false is expected, not text'),
        (
            'name = "a"\nratio = ["x"]',
            'r.toml:2: ratio[0] = "x": a number is expected, not text; write a number',
        ),
        (
            'name = "a"\nratio = "x"',
            'r.toml:2: ratio = "x": a number is expected, not text; allowed: a number or',
        ),
        ('name = "a"\ntravel_mm = [3, 1]', "r.toml:2: travel_mm = [3, 1]: limits are swapped: write [1, 3]"),
        ('name = "a"\ntravel_mm = [3, inf]', "r.toml:2: travel_mm[1] = Infinity: must be a finite number"),
        ('name = "a"\nlimits_mm = [inf, 1]', "r.toml:2: limits_mm = [Infinity, 1]: limits are swapped: write [1, inf]"),
        ('name = "a"\nlimits_mm = [1, nan]', "r.toml:2: limits_mm = [1, NaN]: a limit is not a number: write inf"),
        ('name = "a"\nlimits_mm = [-inf, inf]', "r.toml:2: limits_mm = [-Infinity, Infinity]: neither"),
        ('name = "a"\nname = "b"', "r.toml:2: not valid TOML: Cannot overwrite a value, in: name ="),
        ('name = "a\nb = 2', "r.toml:1: not valid TOML: "),
        ("name = 1979-05-27", "r.toml:1: name: dates are not supported; put text in quotes"),
        ('name = "A b"', 'r.toml:1: name = "A b": must begin with a lower-case letter'),
        ('name = "a"\njoints = 3', "r.toml:2: joints = 3: a table is expected, not a number"),
        (
            'name = "a"\n[joints.q]\nx = 1',
            "r.toml:2: joints.q: the key type is missing; its value must be one of slide, hinge",
        ),
        (
            'name = "a"\n[joints.q]\ntype = "slde"',
            "r.toml:2: joints.q: unknown type 'slde'; did you mean 'slide'?; allowed: slide, hinge",
        ),
        (
            'name = "a"\n# note\n[joints.q]\ntype = "slide"\nlower_mm = 3\nupper_mm = 1',
            "r.toml:5: joints.q.lower_mm = 3: limits are swapped: lower_mm 3 is above upper_mm 1",
        ),
        (
            'name = "a"\n[joints.q]\ntype = "hinge"\nlower_deg = -400\nupper_deg = 1',
            "r.toml:4: joints.q.lower_deg = -400: out of range; allowed: a number >= -360",
        ),
        (
            'name = "a"\npoints = [\n  [1, 2, 3],\n  # comment\n  [1, 2],\n]',
            "r.toml:5: points[1][2]: the list is too short: value 3 is missing; allowed: a number",
        ),
    ],
)
def test_each_mistake_has_its_line_and_its_words(text, expected):
    assert message(text).startswith(expected)
    assert "\n" not in message(text)


def test_several_mistakes_come_in_the_order_of_the_file():
    text = 'name = "a"\nteeth = "x"\n[joints.q]\ntype = "slide"\nlower = 1\nupper_mm = "y"\n'
    assert [row.split(": ")[0] for row in message(text).splitlines()] == ["r.toml:2", "r.toml:5", "r.toml:6"]


def test_a_long_value_is_cut():
    assert len(message(f'name = "{"A" * 500}"')) < 200


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(DescriptionError, match="does not exist"):
        load_toml(tmp_path / "a.toml", Robot)
    with pytest.raises(DescriptionError, match="cannot be read"):
        load_toml(tmp_path, Robot)
    (tmp_path / "b.toml").write_bytes(b'name = "\xff"')
    with pytest.raises(DescriptionError, match="not UTF-8 text at byte 8"):
        load_toml(tmp_path / "b.toml", Robot)


def test_error_at_points_at_a_key_or_at_what_is_around_it(tmp_path):
    file = tmp_path / "a.toml"
    file.write_text('name = "a"\n\n[joints.q1]\ntype = "slide"\n')
    assert str(error_at(file, ("joints", "q1", "type"), "why")) == f"{file}:4: joints.q1.type: why"
    assert str(error_at(file, ("joints", "q1", "axis"), "why")) == f"{file}:3: joints.q1.axis: why"
    assert str(error_at(tmp_path / "b.toml", ("x",), "why")).endswith("b.toml:1: x: why")


def test_lines_survive_everything_that_toml_allows():
    text = '''# top
a = """
[not.a.table]
b = 1
""" # 2
"quoted key" . 'x y' = { c = [1, { d = "]}" }], e = \'\'\'
f = 1\'\'\' } # 6
[[list]]
k = 1979-05-27T07:32:00Z
[list.sub]
m = [ # 11
  "a, b", # 12
  'c#d' , # 13
]
[[list]]
k = 1_000
[ plain . "dotted.name" ]
z = "\\" = ["
'''
    tomllib.loads(text)
    lines = key_lines(text)
    expected = {
        ("a",): 2,
        ("quoted key", "x y", "c", 1, "d"): 6,
        ("quoted key", "x y", "e"): 6,
        ("list", 0): 8,
        ("list", 0, "k"): 9,
        ("list", 0, "sub", "m", 1): 13,
        ("list", 1, "k"): 16,
        ("plain", "dotted.name", "z"): 18,
    }
    assert {keys: lines.get(keys) for keys in expected} == expected
    assert ("b",) not in lines
    assert ("not", "a", "table") not in lines


values = st.recursive(
    st.integers(-9, 9) | st.booleans() | st.text(max_size=8) | st.floats(allow_nan=False),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=12,
)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.dictionaries(st.text(max_size=5), values, max_size=5))
def test_every_value_of_a_generated_file_is_located(data):
    text = tomlkit.dumps(data)
    lines = key_lines(text)

    def walk(value, keys):
        if keys:
            assert keys in lines
        items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        for key, child in items:
            walk(child, (*keys, key))

    walk(tomllib.loads(text), ())


class Patterned(Table):
    protocol: ProtocolSource = "a"
    joints: dict[JointKey, float] = {}  # noqa: RUF012
    other: Annotated[str, Field(pattern="^[0-9]$")] = "1"


@pytest.mark.parametrize(
    ("text", "model", "expected"),
    [
        ('color = "#12345G"', ObjectTable, 'color = "#12345G": must be # and six digits or letters from a to f'),
        ('protocol = "a.tml"', Patterned, 'protocol = "a.tml": must be the name of a protocol, or a file whose name'),
        ('file = "a.txt"', SamplesTable, 'file = "a.txt": must be the name of a file that ends with .csv'),
        ("joints.q1_um = 3", Patterned, "joints.q1_um = 3: the key must be the name of a joint and its unit: NAME_deg"),
        ('other = "a"', Patterned, 'other = "a": must match the regular expression ^[0-9]$'),
    ],
)
def test_a_text_that_is_no_identifier_is_not_judged_as_one(text, model, expected):
    with pytest.raises(DescriptionError) as caught:
        parse_toml(text, model, "r.toml")
    assert f"r.toml:1: {expected}" in str(caught.value)
