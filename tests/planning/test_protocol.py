"""Protocol files: what is read, what is refused and with which words."""

import re
from pathlib import Path

import numpy as np
import pytest

from twin.core.errors import DescriptionError
from twin.planning.protocol import Home, Insertion, Pivot, Positioning, ProtocolTable, Retraction, load_protocol
from twin.planning.protocol.phases.circle import CircleTable
from twin.schema import json_schema, key_lines

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "data" / "protocols"
SHIPPED = sorted((ROOT.parent / "trajectories").glob("*/*.toml"))


def expectation(path: Path) -> str:
    return path.read_text().splitlines()[0].removeprefix("# ")


def test_the_valid_file_raises_no_finding():
    protocol = load_protocol(DATA / "valid.toml")
    assert protocol.findings == ()
    assert [type(p) for p in protocol.phases] == [Positioning, Insertion, Pivot, Pivot, Retraction]
    np.testing.assert_allclose(protocol.waypoints["c"].position, [0.4079, 0.306, 0.2114], atol=1e-15)
    np.testing.assert_allclose(protocol.waypoints["c"].angles, np.deg2rad([10, 15, 10]), atol=1e-15)
    assert protocol.waypoints["t"].depth == pytest.approx(0.04)
    assert protocol.limits["pivot"].tip_speed == pytest.approx(0.02)
    assert protocol.limits["pivot"].rotation_acceleration == pytest.approx(np.deg2rad(80))


@pytest.mark.parametrize("path", sorted(DATA.glob("error_*.toml")), ids=lambda p: p.stem)
def test_error_files_say_what_is_wrong_and_where(path):
    with pytest.raises(DescriptionError) as caught:
        load_protocol(path)
    message = str(caught.value)
    assert expectation(path) in message
    line = re.match(re.escape(str(path)) + r":(\d+): ", message)
    assert line is not None
    assert (int(line[1]) == 1) == (path.stem == "error_no_phases")  # line 1 is the expectation
    assert "\n" not in message


@pytest.mark.parametrize("path", sorted(DATA.glob("warning_*.toml")), ids=lambda p: p.stem)
def test_warning_files_load_and_warn(path):
    findings = load_protocol(path).findings
    assert [f"{f.code}: {f.message}" for f in findings] == [expectation(path)]
    assert {f.severity for f in findings} == {"warning"}


@pytest.mark.parametrize("turns", [10**400, 10**9])
def test_a_circle_has_a_possible_number_of_turns(tmp_path, turns):
    text = (DATA / "valid.toml").read_text(encoding="utf-8")
    head, phases = text[: text.index("[[phases]]")], text[text.index("[[phases]]") :]
    limits = "[limits.circle]\n" + head.partition("[limits.pivot]\n")[2].partition("\n\n")[0] + "\n\n"
    _, first, second, rest = phases.split("[[phases]]", 3)
    circle = f'[[phases]]\nname = "round"\ntype = "circle"\ncentre_mm = [0, 0, 0]\nturns = {turns}\n\n'
    file = tmp_path / "valid.toml"
    file.write_text(f"{head}{limits}[[phases]]{first}[[phases]]{second}{circle}[[phases]]{rest}", encoding="utf-8")
    with pytest.raises(DescriptionError, match="turns"):
        load_protocol(file)


@pytest.mark.parametrize("size", [1e-200, 1e200])
def test_the_axis_of_a_circle_may_have_any_length(size):
    table = CircleTable(type="circle", name="round", centre_mm=(0.0, 0.0, 0.0), normal=(0.0, 3 * size, 4 * size))
    np.testing.assert_allclose(table.phase(None).normal, [0, 0.6, 0.8], atol=1e-12)


def test_an_error_points_at_the_line_of_its_key():
    path = DATA / "error_missing_unit.toml"
    with pytest.raises(DescriptionError) as caught:
        load_protocol(path)
    line = int(str(caught.value).split(":")[1])
    assert path.read_text().splitlines()[line - 1] == "depth = 40"


def test_a_missing_file_lists_its_neighbours():
    with pytest.raises(DescriptionError, match=r"the file does not exist.*valid\.toml"):
        load_protocol(DATA / "nothing.toml")


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: f"{p.parent.name}-{p.stem}")
def test_shipped_protocols_load_and_are_named_like_their_file(path):
    protocol = load_protocol(path)
    assert (protocol.name, protocol.robot) == (path.stem, path.parent.name)
    parameters = protocol.parameters()
    assert len({p.name for p in parameters}) == len(parameters)
    assert all(p.note and np.isfinite(p.value) for p in parameters)
    assert all(p.provenance == "ASSUMED" for p in parameters if "speed" in p.name or "tolerance" in p.name)


def test_table2_holds_the_printed_poses():
    printed = load_protocol(ROOT.parent / "trajectories/sils/table2_printed.toml")
    table = {  # PUBLISHED: 002_abb87c5450b9371c.txt, Table 2
        "c": (407.9, 306, 211.4, 10, 15, 10),
        "b": (380, 280, 185, 0, 0, 0),
        "i": (380, 280, 145, 0, 0, 0),
        "t": (400, 310, 135, 15, 20, 10),
    }
    assert set(printed.waypoints) == set(table)
    for name, row in table.items():
        w = printed.waypoints[name]
        np.testing.assert_allclose([*w.position * 1e3, *np.rad2deg(w.angles)], row, atol=1e-10)
        assert w.provenance == "PUBLISHED"


def test_the_home_phase_goes_to_the_start_unless_home_is_named(tmp_path):
    text = (ROOT.parent / "trajectories/sils/table2.toml").read_text()
    file = tmp_path / "p.toml"
    file.write_text(text.replace('start = "c"', 'start = "c"\nhome = "i"'))
    assert load_protocol(file).phases[-1] == Home("home", "i")
    file.write_text(text)
    assert load_protocol(file).phases[-1] == Home("home", "c")


def test_the_json_schema_knows_every_phase_type():
    schema = json_schema(ProtocolTable)
    phases = schema["properties"]["phases"]["items"]["discriminator"]["mapping"]
    known = {"positioning", "joints", "auxiliary", "samples", "insertion", "pivot", "circle"}
    known |= {"retraction", "home", "free"}
    assert set(phases) == known
    assert schema["additionalProperties"] is False


def test_every_key_of_a_shipped_file_has_its_own_line():
    for path in SHIPPED:
        text = path.read_text()
        lines = key_lines(text)
        rows = text.splitlines()
        for keys, line in lines.items():
            if isinstance(keys[-1], str):
                assert keys[-1] in rows[line - 1]
