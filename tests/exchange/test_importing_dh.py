"""Tables of Denavit-Hartenberg parameters become robots with equations; every fault is named with file and line."""

from __future__ import annotations

import ast
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin import cli
from twin.core.errors import SourceError
from twin.exchange.formats.dh.table import read_table
from twin.exchange.read import read
from twin.exchange.read.imported_robot import DhOptions, dh_options, rest_poses

DATA = Path(__file__).parents[1] / "data/dh"


def turned(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    T = np.eye(4)
    T[i, i] = T[j, j] = c
    T[i, j], T[j, i] = -s, s
    return T


def moved(axis, length):
    T = np.eye(4)
    T["xyz".index(axis), 3] = length
    return T


def standard(a, alpha, d, theta):
    """The matrix as textbooks print it (Spong, Hutchinson, Vidyasagar, equation 3.10)."""
    ca, sa, ct, s = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
    return np.array(
        [[ct, -s * ca, s * sa, a * ct], [s, ct * ca, -ct * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]], dtype=float
    )


def modified(a, alpha, d, theta):
    """The matrix as Craig prints it (Introduction to Robotics, equation 3.6)."""
    ca, sa, ct, s = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
    return np.array(
        [[ct, -s, 0, a], [s * ca, ct * ca, -sa, -sa * d], [s * sa, ct * sa, ca, ca * d], [0, 0, 0, 1]], dtype=float
    )


def khalil(d, alpha, r, theta, gamma, b):
    return turned("z", gamma) @ moved("z", b) @ modified(d, alpha, r, theta)


def hayati(a, alpha, d, theta, beta):
    if beta is None:
        return standard(a, alpha, d, theta)
    return turned("z", theta) @ moved("x", a) @ turned("x", alpha) @ turned("y", beta)


angle = st.floats(-3.1, 3.1).map(lambda x: round(x, 6))
length = st.floats(-2, 2).map(lambda x: round(x, 6))
row = st.fixed_dictionaries(
    {
        "kind": st.sampled_from(["R", "P", "R", "fixed"]),
        "a": length,
        "alpha": angle,
        "d": length,
        "theta": angle,
        "gamma": angle,
        "b": length,
        "beta": st.one_of(st.none(), angle),
        "offset": length,
        "q": length,
    }
)


@given(
    rows=st.lists(row, min_size=1, max_size=6).filter(lambda rows: any(r["kind"] != "fixed" for r in rows)),
    convention=st.sampled_from(["standard", "modified", "khalil", "hayati"]),
    units=st.sampled_from([("m", 1.0, "rad", 1.0), ("mm", 1e-3, "deg", np.pi / 180), ("cm", 1e-2, "rad", 1.0)]),
)
@settings(max_examples=60, deadline=None)
def test_poses_are_those_of_the_matrices_of_the_textbooks(tmp_path_factory, rows, convention, units):
    name_l, size_l, name_a, size_a = units
    lines = []
    expected = np.eye(4)
    values = {}
    for i, r in enumerate(rows):
        kind = r["kind"]
        r = r | {"beta": r["beta"] if kind == "R" else None}
        if convention == "hayati" and r["beta"] is not None:
            r["d"] = 0
        offset, q = (r["offset"], r["q"]) if kind != "fixed" else (0, 0)
        theta = r["theta"] + (q + offset) * (kind != "P")
        d = r["d"] + (q + offset) * (kind == "P")
        values[f"q{i + 1}"] = q
        numbers = [r["alpha"] / size_a, r["theta"] / size_a]
        if convention == "khalil":  # the length along x is d, the one along z is r
            expected = expected @ khalil(r["a"], r["alpha"], d, theta, r["gamma"], r["b"])
            numbers += [r["a"] / size_l, r["d"] / size_l, r["gamma"] / size_a, r["b"] / size_l]
        else:
            numbers += [r["a"] / size_l, r["d"] / size_l]
            if convention == "hayati":
                expected = expected @ hayati(r["a"], r["alpha"], d, theta, r["beta"])
                numbers.append("-" if r["beta"] is None else r["beta"] / size_a)
            else:
                expected = expected @ {"standard": standard, "modified": modified}[convention](
                    r["a"], r["alpha"], d, theta
                )
        numbers.append(offset / (size_l if kind == "P" else size_a))
        lines.append(",".join([kind, *map(str, numbers)]))
    heads = {"khalil": "d,r,gamma,b", "hayati": "a,d,beta"}.get(convention, "a,d")
    path = tmp_path_factory.mktemp("dh") / "arm.csv"
    path.write_text("\n".join([f"type,alpha,theta,{heads},offset", *lines]) + "\n")
    found = read(path, dh=DhOptions(convention, name_l, name_a))
    last = f"link{len(rows)}"
    joints = {j.name for j in found.mechanism.active}
    T = rest_poses(found.mechanism, {name: q for name, q in values.items() if name in joints})[last]
    np.testing.assert_allclose(T, expected, atol=1e-9)
    scope = {}
    exec(found.formula, scope)
    numbers = {name: parameter.value for name, parameter in scope["PARAMETERS"].items()}
    q = np.array([values[j.name] for j in found.mechanism.active])
    np.testing.assert_allclose(scope["forward"](q, **numbers), expected, atol=1e-9)


PUBLISHED = {
    # {file: (driven joints, q in rad, tool position in m at q)}; positions are sums of lengths of stretched arms
    "puma560.csv": (6, np.zeros(6), [0.4318 + 0.0203, -0.15005, 0.6718 + 0.4318]),
    "panda.md": (7, np.zeros(7), [0.088, 0, 0.333 + 0.316 + 0.384 - 0.107]),
    "iiwa14.tex": (7, np.zeros(7), [0, 0, 0.36 + 0.42 + 0.4 + 0.126]),
    "staubli_rx90.toml": (6, np.zeros(6), [0.45, -0.45 * 0, 0.45]),
    "toolbox.md": (2, np.array([0, -np.pi / 2]), [0.4318, 0, 0.6718]),
    "slide.csv": (2, np.zeros(2), None),
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_tables_are_robots_that_reach_what_is_known(name):
    driven, q, p = PUBLISHED[name]
    found = read(DATA / name)
    assert len(found.mechanism.active) == driven
    values = dict(zip([j.name for j in found.mechanism.active], q, strict=True))
    body = found.mechanism.frame(found.mechanism.tool).body
    if p is not None:
        np.testing.assert_allclose(rest_poses(found.mechanism, values)[body][:3, 3], p, atol=1e-12)


@pytest.mark.parametrize("name", ["panda.md", pytest.param("slide.csv", marks=pytest.mark.slow)])
def test_new_makes_a_robot_whose_equations_agree(name, tmp_path, capsys):
    target = tmp_path / "arm"
    assert cli.main(["new", "arm", str(DATA / name), "--out", str(target), "--quiet"]) == 0
    assert "the equations are in formula.py" in capsys.readouterr().out
    assert f'"{name}' in (target / "formula.py").read_text().replace("CITED", "").replace('"", ', "")
    assert cli.main(["validate", str(target), "--quiet"]) == 0
    assert "AGREE: equations, mechanism and stage agree" in capsys.readouterr().out


def test_a_wrong_number_of_the_equations_is_found(tmp_path, capsys):
    target = tmp_path / "arm"
    assert cli.main(["new", "arm", str(DATA / "toolbox.md"), "--out", str(target), "--quiet"]) == 0
    file = target / "formula.py"
    file.write_text(file.read_text().replace("m(0.6718", "m(0.6728"))
    assert cli.main(["validate", str(target), "--quiet"]) == 1


def test_the_name_of_a_table_never_becomes_code(tmp_path):
    table = tmp_path / 'x""" + chr(0); y = """\\N{.csv'
    shutil.copy(DATA / "slide.csv", table)
    target = tmp_path / "arm"
    assert cli.main(["new", "arm", str(table), "--out", str(target), "--quiet"]) == 0
    tree = ast.parse((target / "formula.py").read_text())
    assert "chr" not in {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    assert "chr(0)" in ast.get_docstring(tree)


def test_equations_of_the_user_are_kept(tmp_path):
    target = tmp_path / "arm"
    arguments = ["new", "arm", str(DATA / "toolbox.md"), "--out", str(target), "--quiet"]
    assert cli.main(arguments) == 0
    (target / "formula.py").write_text("# mine\n")
    assert cli.main([*arguments, "--force"]) == 0
    assert (target / "formula.py").read_text() == "# mine\n"


def test_what_the_headings_say_needs_no_option():
    said = {name: read_table(DATA / name, DhOptions()).convention for name in PUBLISHED}
    assert said == {
        "puma560.csv": "standard",
        "panda.md": "modified",
        "iiwa14.tex": "standard",
        "staubli_rx90.toml": "khalil",
        "toolbox.md": "standard",
        "slide.csv": "modified",
    }


def test_options_state_convention_and_units(tmp_path):
    path = tmp_path / "arm.csv"
    path.write_text("theta;d;a;alpha\nq1;0;100;90\n")
    with pytest.raises(SourceError, match=r"arm\.csv:1: .*--dh standard"):
        read(path, dh=dh_options(None, "mm,deg"))
    with pytest.raises(SourceError, match=r"arm\.csv:2: the unit of lengths .* Give it by --units"):
        read(path, dh=dh_options("standard", "deg"))
    table = read_table(path, dh_options("standard", "mm, deg"))
    assert table.rows[0].values["a"].value == 0.1
    assert table.rows[0].values["alpha"].value == pytest.approx(np.pi / 2)
    with pytest.raises(SourceError, match=r"--units inch,deg: there is no unit 'inch'"):
        dh_options(None, "inch,deg")
    good = DATA.parent / "importing/good.urdf"
    with pytest.raises(SourceError, match=r"good\.urdf: --dh and the units are for a table"):
        read(good, dh=dh_options("standard", None))


@pytest.mark.parametrize(
    "cell", ["-q1", "2*q1", "q1*q1", "q1 - q2", "sqrt(q1)", "__import__('os')", "1e999", "a" * 200]
)
def test_a_coordinate_stands_alone_or_with_an_offset(tmp_path, cell):
    path = tmp_path / "arm.csv"
    path.write_text(f"theta;d;a;alpha\n{cell};0;100;90\nq2;0;100;0\n")
    with pytest.raises(SourceError, match=r"arm\.csv:2: theta = "):
        read(path, dh=dh_options("standard", "mm,deg"))


@pytest.mark.parametrize("cell", ["q1", "d3", "theta_1"])
def test_the_name_of_a_coordinate_is_no_length_along_x(tmp_path, cell):
    path = tmp_path / "arm.csv"
    path.write_text(f"theta;d;a;alpha\nq1;0;{cell};90\n")
    with pytest.raises(SourceError, match=rf"arm\.csv:2: a = '{cell}' is not a number"):
        read(path, dh=dh_options("standard", "mm,deg"))


@pytest.mark.parametrize(
    ("cell", "radians"),
    [
        ("-\\frac{\\pi}{2}", -np.pi / 2),
        ("−π/2", -np.pi / 2),
        ("pi/2", np.pi / 2),
        ("np.pi", np.pi),
        ("2pi/3", 2 * np.pi / 3),
    ],
)
def test_multiples_of_pi_are_read_as_papers_print_them(tmp_path, cell, radians):
    path = tmp_path / "arm.csv"
    path.write_text(f"theta;d;a;alpha\nq1;0;0;{cell}\n", encoding="utf-8")
    assert read_table(path, DhOptions("standard")).rows[0].values["alpha"].value == radians


def test_what_is_usual_is_told_where_the_table_is_silent(tmp_path):
    path = tmp_path / "arm.csv"
    path.write_text("theta;d;a;alpha\n90;0;100;90\n0;0;100;0\n")
    found = read(path, dh=dh_options("standard", "mm,deg"))
    assert [j.type for j in found.mechanism.joints] == ["revolute", "revolute"]
    (told,) = (f.message for f in found.findings if f.code == "import.dh" and f.severity == "warning")
    assert "all are hinges, and theta is their offset" in told
    (fixed,) = (f.message for f in read(DATA / "panda.md").findings if f.severity == "warning" and "line" in f.message)
    assert fixed == "the row in line 12 has no coordinate, unlike others: it is a fixed joint."


def test_limits_and_offsets_have_the_unit_of_their_joint():
    slide, hinge, flange = read(DATA / "slide.csv").mechanism.joints
    assert slide.limits == pytest.approx((-0.05, 0.3))
    assert slide.T_parent_joint[2, 3] == pytest.approx(0.12)
    assert hinge.limits == pytest.approx((-np.radians(170), np.radians(170)))
    assert (flange.type, flange.limits) == ("fixed", None)


BAD = {
    "error_a_name_for_a_length.csv": ":4: a [mm] = 'L2' is not a number",
    "error_branch.csv": ":4: the antecedent of joint 3 is '1', but only chains are read",
    "error_contradictory_convention.csv": ":2: the convention is contradictory: the key `convention` says standard and",
    "error_decimal_comma.csv": ":4: a [mm] = '0,3' is not a number",
    "error_empty.csv": "the file has no table",
    "error_hayati_with_d.csv": ":3: a row of Hayati with beta has no d, but d = '5'",
    "error_heading_twice.csv": ":2: the heading 'a [mm]' stands twice",
    "error_key_missing_in_a_row.toml": ":8: this [[joint]] has no alpha, but another has",
    "error_kind_contradicts.csv": ":3: the kind 'P' contradicts the variable in theta",
    "error_limits_swapped.csv": ":3: the lower limit is not below the upper limit: 90 and -90",
    "error_list_in_a_row.toml": ":4: a = [1] is not a number or a text",
    "error_missing_cell.csv": ":4: the row has 4 cells (2 | q2 | 0 | 300), but there are 5 headings",
    "error_missing_column.csv": ":2: the standard convention needs the columns d, but the headings are",
    "error_missing_row.csv": ":4: the row of joint 2 is missing: row 2 is joint 3",
    "error_mixed_cell_units.csv": ":4: mixed units: the heading 'a [mm]' is in mm, but a = '0.3 m' in m",
    "error_mixed_heading_units.csv": ":2: mixed units: the heading 'a [m]' is in m, but the heading 'd [mm]' in mm",
    "error_mixed_pi_and_degrees.csv": ":3: mixed units: alpha = 'pi/2' is in rad, but alpha = '90' is more than a turn",
    "error_nan.csv": ":4: a [mm] = 'nan' is not a number",
    "error_no_convention.csv": ":1: the headings (joint | theta [deg] | d [mm] | a [mm] | alpha [deg]) do not say",
    "error_no_joint.toml": "the file has no [[joint]]",
    "error_no_rows.csv": ":2: the table has no rows",
    "error_no_table.md": "the file has no table",
    "error_no_table.tex": "the file has no table",
    "error_no_unit.csv": ":3: the unit of lengths (d = '100') is not stated",
    "error_not_a_number.csv": ":4: a [mm] = '3OO' is not a number",
    "error_not_toml.toml": "the file is not TOML: Expected ']]' at the end of an array declaration (at line 1",
    "error_pi_in_degrees.csv": ":3: mixed units: the heading 'alpha [deg]' is in deg, but alpha = 'pi/2' in rad",
    "error_rad_in_degrees.csv": ":3: mixed units: alpha = '1.5708' is a quarter or half turn in rad, but the table is",
    "error_two_coordinates.csv": ":5: theta and d are both variables (q3, d3): a joint has one",
    "error_two_names_of_a_column.csv": ":2: the headings 'link length [mm]' and 'a [mm]' mean the same",
    "error_unknown_convention.csv": ":2: there is no convention 'usual'; use one of standard, modified, khalil, hayati",
    "error_unknown_heading.csv": ":2: the heading 'height [mm]' is not known",
    "error_unknown_key.toml": ":2: there is no key 'unit' with the value 'mm, deg'",
    "error_unknown_kind.csv": ":3: there is no kind of joint 'screw'",
    "error_unknown_unit.toml": ":3: units: there is no unit 'inch'",
    "error_wrong_unit.csv": ":2: the heading 'a [deg]' has the unit deg, but a is a length",
}


def test_every_bad_table_has_its_message():
    assert {p.name for p in DATA.glob("error_*")} == set(BAD)


@pytest.mark.parametrize("name", sorted(BAD))
def test_a_bad_table_is_refused_with_file_line_and_value(name, tmp_path):
    shutil.copy(DATA / name, tmp_path)
    with pytest.raises(SourceError) as error:
        read(tmp_path / name)
    assert f"{name}{BAD[name]}" in str(error.value).replace(f"{name}: ", name)


def test_a_column_of_lower_limits_alone_is_told(tmp_path):
    path = tmp_path / "arm.csv"
    path.write_text("theta [deg],d [mm],a [mm],alpha [deg],lower\nq1,0,100,0,-90\n")
    table = read_table(path, DhOptions(convention="standard"))
    assert table.rows[0].limits is None
    assert "the column 'lower' is not read, because there is no column of upper limits" in " ".join(table.assumptions)


@pytest.mark.parametrize("column", ["offset", "lower", "upper"])
def test_offsets_and_limits_without_a_unit_are_no_radians(column, tmp_path):
    path = tmp_path / "arm.csv"
    limits = {"offset": ("offset", "90"), "lower": ("lower,upper", "-90,1"), "upper": ("lower,upper", "-1,90")}
    heading, cell = limits[column]
    path.write_text(f"theta,d,a,alpha,{heading}\nq1,0,0,0,{cell}\n")
    with pytest.raises(SourceError, match=rf"arm\.csv:2: the unit of angles \({heading.split(',')[0]} = "):
        read_table(path, DhOptions("standard"))
    assert read_table(path, dh_options("standard", "deg")).rows[0].line == 2


def test_offsets_and_limits_have_the_unit_of_their_heading_or_of_theta(tmp_path):
    path = tmp_path / "arm.csv"
    path.write_text("theta,d,a,alpha,offset [deg]\nq1,0,0,0,90\n")
    assert read_table(path, DhOptions("standard")).rows[0].values["theta"].value == pytest.approx(np.pi / 2)
    path.write_text("theta [deg],d [mm],a,alpha,offset,lower,upper\n0,d1,0,0,120,-50,300\nq2,0,0,0,90,-170,170\n")
    slide, hinge = read_table(path, DhOptions("standard")).rows
    assert slide.values["d"].value == pytest.approx(0.12)
    assert slide.limits == pytest.approx((-0.05, 0.3))
    assert hinge.values["theta"].value == pytest.approx(np.pi / 2)
    assert hinge.limits == pytest.approx((-np.radians(170), np.radians(170)))
    path.write_text("theta [deg],d [mm],a,alpha,offset [rad]\nq1,0,0,0,1\n")
    with pytest.raises(SourceError, match=r"arm\.csv:1: mixed units: the heading 'theta \[deg\]' .*'offset \[rad\]'"):
        read_table(path, DhOptions("standard"))


@pytest.mark.parametrize(
    ("cell", "metres"),
    [("4·10⁻³", 4e-3), ("4×10⁻³", 4e-3), (r"$4\cdot10^{-3}$", 4e-3), ("1.5*10^2", 150.0), ("2*10**3", 2000.0)],
)
def test_powers_of_ten_are_read_as_papers_print_them(tmp_path, cell, metres):
    path = tmp_path / "arm.csv"
    path.write_text(f"theta;d [m];a;alpha\nq1;0;{cell};0\n", encoding="utf-8")
    assert read_table(path, DhOptions("standard")).rows[0].values["a"].value == pytest.approx(metres, rel=1e-15)


@pytest.mark.parametrize("cell", ["2**3", "0x10", "0b1", "1_0", "4·2⁻³", "10^0.5", "10**99"])
def test_numbers_of_programs_are_refused(tmp_path, cell):
    path = tmp_path / "arm.csv"
    path.write_text(f"theta;d;a;alpha\nq1;0;{cell};0\n", encoding="utf-8")
    with pytest.raises(SourceError, match=rf"arm\.csv:2: a = '{re.escape(cell)}' is not a number"):
        read_table(path, dh_options("standard", "m,rad"))


@pytest.mark.parametrize("text", ["not modified", "never Craig", "non-standard, unlike modified"])
def test_a_denied_convention_is_no_statement(tmp_path, text):
    path = tmp_path / "arm.csv"
    path.write_text(f"# convention: {text}\ntheta [deg],d [m],a,alpha\nq1,0,1,0\n")
    with pytest.raises(SourceError, match=rf"arm\.csv:2: there is no convention '{text}'"):
        read_table(path, DhOptions())


def test_a_row_of_dashes_is_no_rule(tmp_path):
    path = tmp_path / "arm.md"
    rows = "| θ | d | a | α |\n|---|---|---|---|\n| q1 | 0 | 1 | 0 |\n"
    path.write_text(rows + "| - | - | - | - |\n| q2 | 0 | 1 | 0 |\n")
    with pytest.raises(SourceError, match=r"arm\.md:4: α = '-' is not a number"):
        read_table(path, dh_options("standard", "m,rad"))
    path.write_text(rows.replace("|---|---|---|---|", "|-|-|-|-|") + "| q2 | 0 | 1 | 0 |\n")
    assert len(read_table(path, dh_options("standard", "m,rad")).rows) == 2


def test_titles_of_markdown_are_no_tables_and_a_sharp_is_a_heading(tmp_path):
    path = tmp_path / "arm.md"
    path.write_text("# The arm | version 2 | of 2024\n\n# | θ | d | a | α\n--|--|--|--|--\n1 | q1 | 0 | 1 | 0\n")
    assert len(read_table(path, dh_options("standard", "m,rad")).rows) == 1
    path = tmp_path / "arm.csv"
    path.write_text("# from the manual, page 3\n#,theta,d,a,alpha\n1,q1,0,1,0\n# the wrist\n2,q2,0,1,0\n")
    assert len(read_table(path, dh_options("standard", "m,rad")).rows) == 2


def test_coordinates_are_numbered_in_the_order_of_the_rows(tmp_path):
    path = tmp_path / "arm.csv"
    path.write_text("theta,d,a,alpha\nq2,0,1,0\nq1,0,1,0\n")
    with pytest.raises(SourceError, match=r"arm\.csv:3: the coordinate q1 stands after q2"):
        read_table(path, dh_options("standard", "m,rad"))
    path.write_text("theta,d,a,alpha\nq1,0,1,0\nq3,0,1,0\n")
    with pytest.raises(SourceError, match=r"arm\.csv:3: the row of a joint is missing: q3 follows q1"):
        read_table(path, dh_options("standard", "m,rad"))
    path.write_text("theta,d,a,alpha\nq1,0,1,0\n0,0,1,0\nq3,0,1,0\n")
    assert [row.kind for row in read_table(path, dh_options("standard", "m,rad")).rows] == [
        "revolute",
        "fixed",
        "revolute",
    ]
