"""Sides of `twin compare`: tables of Denavit-Hartenberg parameters, equations, measured poses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import twin
from twin.cli import main
from twin.core.errors import TwinError

ROWS = ((0.3, 0.1, 90.0), (0.0, 0.4, 0.0), (0.05, 0.02, 90.0), (0.35, 0.0, -90.0))
"""d in m, a in m, alpha in degrees of the rows of a table, distal."""


def table(file: Path, *, a2: float = 0.4) -> Path:
    """Write a distal table of four hinges in mm and degrees, without its convention and units."""
    lines = ["theta,d,a,alpha"]
    for i, (d, a, alpha) in enumerate(ROWS, 1):
        length = a2 if i == 2 else a
        lines.append(f"q{i},{1e3 * d:g},{1e3 * length:g},{alpha:g}")
    file.write_text("\n".join(lines) + "\n")
    return file


def urdf(file: Path, *, a2: float = 0.4) -> Path:
    """Write the same arm as a URDF: each joint's frame is the frame after the row before."""
    lines = ['<robot name="arm">']
    lines += [f'<link name="link{i}"/>' for i in range(len(ROWS) + 1)] + ['<link name="tool"/>']
    place = "0 0 0"
    turn = 0.0
    for i, (d, a, alpha) in enumerate(ROWS, 1):
        lines.append(
            f'<joint name="q{i}" type="continuous"><parent link="link{i - 1}"/><child link="link{i}"/>'
            f'<origin xyz="{place}" rpy="{turn!r} 0 0"/><axis xyz="0 0 1"/></joint>'
        )
        place = f"{a2 if i == 2 else a:g} 0 {d:g}"
        turn = float(np.radians(alpha))
    lines.append(
        f'<joint name="end" type="fixed"><parent link="link{len(ROWS)}"/><child link="tool"/>'
        f'<origin xyz="{place}" rpy="{turn!r} 0 0"/></joint></robot>'
    )
    file.write_text("\n".join(lines))
    return file


def test_convention_and_units_of_a_table_are_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [str(table(tmp_path / "arm.csv")), str(urdf(tmp_path / "arm.urdf"))]
    assert main(["compare", *files]) == 2
    assert "--dh standard" in capsys.readouterr().err
    assert main(["compare", *files, "--dh", "standard", "--units", "mm,deg"]) == 0
    found = twin.compare(table(tmp_path / "b.csv", a2=0.42), files[1], dh="standard", units="mm,deg").pairs[0]
    assert [item.joint for item in found.differences] == ["q3"]
    assert found.differences[0].shift == pytest.approx(0.02, abs=1e-9)
    with pytest.raises(TwinError, match="no side is one"):
        twin.compare(files[1], files[1], dh="standard")


# -- measured poses ---------------------------------------------------------------------------------------------

BASE = ((0.3, -2.0, 1.0), (1.0, 0.2, -0.3))
TOOL = ((0.1, 0.4, -1.0), (0.1, 0.02, 0.3))
"""Rotation vector in rad and shift in m of the frames of a measuring device."""

ROTATIONS = {
    "quaternion": "qw,qx,qy,qz",
    "matrix": ",".join(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)),
    "rpy": "roll [rad],pitch [rad],yaw [rad]",
    "": "",
}


def forward(q: np.ndarray, rows: Sequence[Sequence[float]] = ROWS) -> np.ndarray:
    """Return T_base_tool (4, 4) by the matrices of a textbook."""
    T = np.eye(4)
    for (d, a, alpha), angle in zip(rows, q, strict=True):
        c, s = np.cos(angle), np.sin(angle)
        ca, sa = np.cos(np.radians(alpha)), np.sin(np.radians(alpha))
        T = T @ np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])
    return T


def device(frame: tuple[tuple[float, ...], tuple[float, ...]]) -> np.ndarray:
    """Return a frame (4, 4) of a measuring device."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(frame[0]).as_matrix()
    T[:3, 3] = frame[1]
    return T


def measured(
    file: Path,
    *,
    a2: float = 0.4,
    zero2: float = 0.0,
    sign3: float = 1.0,
    noise: float = 0.0,
    count: int = 40,
    rotation: str = "quaternion",
    head: str = "",
) -> Path:
    """Write a table of poses measured in the frames of a device, with noise in m and twice as many rad."""
    rng = np.random.default_rng(3)
    rows = [list(row) for row in ROWS]
    rows[1][1] = a2
    headings = "q1 [deg],q2 [deg],q3 [deg],q4 [deg],x [mm],y [mm],z [mm]"
    if rotation:
        headings += "," + ROTATIONS[rotation]
    lines = [head] if head else []
    lines.append(headings)
    for _ in range(count):
        q = rng.uniform(-2.5, 2.5, 4)
        T = device(BASE) @ forward(q * [1, 1, sign3, 1] + [0, zero2, 0, 0], rows) @ device(TOOL)
        R = Rotation.from_matrix(T[:3, :3]) * Rotation.from_rotvec(rng.normal(0, 2 * noise, 3))
        p = T[:3, 3] + rng.normal(0, noise, 3)
        numbers: list[float] = []
        if rotation == "quaternion":
            numbers = list(np.roll(R.as_quat(), 1))
        elif rotation == "matrix":
            numbers = list(R.as_matrix().ravel())
        elif rotation == "rpy":
            numbers = list(R.as_euler("xyz"))
        cells = [*np.degrees(q), *(1e3 * p), *numbers]
        lines.append(",".join(f"{cell:.12g}" for cell in cells))
    file.write_text("\n".join(lines) + "\n")
    return file


@pytest.mark.parametrize("rotation", list(ROTATIONS))
def test_measured_poses_agree_after_the_fit_of_base_and_tool(tmp_path: Path, rotation: str) -> None:
    found = twin.compare(measured(tmp_path / "poses.csv", rotation=rotation), urdf(tmp_path / "arm.urdf")).pairs[0]
    assert found.kinematics == "agree"
    assert found.poses is not None
    assert (found.poses.rows, found.poses.rotations) == (40, bool(rotation))
    assert found.poses.base == pytest.approx(device(BASE), abs=1e-6)
    assert found.poses.tool[:3, 3] == pytest.approx(device(TOOL)[:3, 3], abs=1e-6)
    assert found.poses.distance < 1e-6


@pytest.mark.parametrize("head", ["", "# noise: 0.05 mm, 0.00573 deg"])
def test_noise_is_no_difference_and_is_stated(tmp_path: Path, head: str) -> None:
    result = twin.compare(urdf(tmp_path / "arm.urdf"), measured(tmp_path / "poses.csv", noise=5e-5, head=head))
    fit = result.pairs[0].poses
    assert result.verdict == "agree"
    assert fit is not None
    assert fit.noise is not None
    assert fit.noise == pytest.approx((5e-5, 1e-4), rel=0.2)
    assert fit.stated == bool(head)
    assert fit.distance > 5e-5


def test_a_wrong_length_is_found_in_noisy_poses(tmp_path: Path) -> None:
    files = (measured(tmp_path / "poses.csv", a2=0.401, noise=5e-5), urdf(tmp_path / "arm.urdf"))
    result = twin.compare(*files)
    found = result.pairs[0]
    assert result.verdict == "disagree"
    assert [item.joint for item in found.differences] == ["q3"]
    assert found.poses is not None
    assert 0 < found.poses.uncertainty < 5e-5
    assert found.differences[0].shift == pytest.approx(0.001, abs=4 * found.poses.uncertainty)
    edit = found.differences[0].edits[0]
    assert edit.old == "0.4"
    assert float(edit.new) == pytest.approx(0.401, abs=4 * found.poses.uncertainty)
    assert found.worst is not None
    assert found.worst.q.keys() == {"q1", "q2", "q3", "q4"}


@pytest.mark.parametrize(
    ("changed", "kind", "joint"),
    [({"zero2": 0.02}, "zero", "q2"), pytest.param({"sign3": -1.0}, "sign", "q3", marks=pytest.mark.slow)],
)
def test_zeros_and_signs_of_measured_poses_are_conventions(
    tmp_path: Path, changed: dict[str, float], kind: str, joint: str
) -> None:
    table_file = measured(tmp_path / "poses.csv", noise=5e-5, **changed)  # pyright: ignore[reportArgumentType]
    found = twin.compare(table_file, urdf(tmp_path / "arm.urdf")).pairs[0]
    assert [(item.kind, item.joint) for item in found.conventions] == [(kind, joint)]
    assert found.kinematics == "agree after conventions"


@pytest.mark.slow
def test_poses_of_another_robot_disagree(tmp_path: Path) -> None:
    file = measured(tmp_path / "poses.csv")
    lines = file.read_text().splitlines()
    mixed = [lines[0]]
    for line, other in zip(lines[1:], lines[2:] + lines[1:2], strict=True):
        mixed.append(",".join([*line.split(",")[:4], *other.split(",")[4:]]))
    file.write_text("\n".join(mixed))
    result = twin.compare(file, urdf(tmp_path / "arm.urdf"))
    assert result.verdict == "disagree"
    assert [f.code for f in result.findings] == ["compare.poses"]


def test_stated_noise_judges_what_the_rows_alone_would_call_noise(tmp_path: Path) -> None:
    file = measured(tmp_path / "poses.csv", noise=5e-4, head="# noise: 0.05 mm, 0.00573 deg")
    assert twin.compare(file, urdf(tmp_path / "arm.urdf")).verdict == "disagree"


@pytest.mark.parametrize("head", ["# noise: 0.05 mm, 0.00573 deg", "# noise: 0.5 mm, 0.0573 deg"])
def test_stated_noise_hides_no_error_of_one_length(tmp_path: Path, head: str) -> None:
    """The length is wrong by two standard deviations: as a share of all freedoms that is little."""
    file = measured(tmp_path / "poses.csv", a2=0.4001, noise=5e-5, count=60, head=head)
    found = twin.compare(file, urdf(tmp_path / "arm.urdf")).pairs[0]
    assert found.kinematics == "disagree"
    assert [item.joint for item in found.differences] == ["q3"]
    assert found.poses is not None
    assert found.differences[0].shift == pytest.approx(1e-4, abs=4 * found.poses.uncertainty)


@pytest.mark.parametrize("head", ["# noise: 0.05 mm, 0.00573 deg", "# noise: 0.5 mm, 0.0573 deg"])
def test_stated_noise_of_the_same_robot_agrees(tmp_path: Path, head: str) -> None:
    file = measured(tmp_path / "poses.csv", noise=5e-5, count=60, head=head)
    assert twin.compare(file, urdf(tmp_path / "arm.urdf")).verdict == "agree"


def test_columns_of_joints_that_only_holds_are_zero(tmp_path: Path) -> None:
    arm = urdf(tmp_path / "arm.urdf")
    file = measured(tmp_path / "poses.csv")
    with pytest.raises(TwinError, match=r"poses\.csv:2: joint 'q4' is at .*°, but --only holds it at zero"):
        twin.compare(file, arm, only=("q1", "q2", "q3"))
    with pytest.raises(TwinError, match=r"poses.*joint of the table.*'q9'"):
        twin.compare(file, arm, only=("q1", "q9"))
    lines = file.read_text().splitlines()[:1]
    for q in np.random.default_rng(4).uniform(-150, 150, (20, 3)):
        x, y, z = 1e3 * forward(np.radians([*q, 0.0]))[:3, 3]
        lines.append(",".join(f"{cell:.12g}" for cell in (*q, 0.0, x, y, z)))
    held = tmp_path / "held.csv"
    held.write_text("\n".join([lines[0].removesuffix(",qw,qx,qy,qz"), *lines[1:]]) + "\n")
    assert twin.compare(held, arm, only=("Q1", "q_2", "q3")).verdict == "agree"


GOOD = "q1 [deg],q2 [deg],q3 [deg],q4 [deg],x [mm],y [mm],z [mm]"
BAD_POSES = {
    "nan": (GOOD + "\n1,2,3,4,5,6,7" * 4 + "\n1,2,nan,4,5,6,7", r":6: q3 \[deg\] = 'nan' is not a number"),
    "count": (GOOD + "\n1,2,3,4,5,6,7" * 4 + "\n1,2,3,4,5,6", ":6: the row has 6 cells, but there are 7 headings"),
    "position": (GOOD.replace("y [mm],z", "y [deg],z") + "\n1,2,3,4,5,6,7" * 5, r":1: .*'y \[deg\]' is in deg"),
    "unit": (GOOD.replace("q2 [deg]", "q2") + "\n1,2,3,4,5,6,7" * 5, ":1: the unit of 'q2' is not stated"),
    "unknown unit": (GOOD.replace("x [mm]", "x [inch]") + "\n1,2,3,4,5,6,7" * 5, r":1: .*'x \[inch\]' has no known"),
    "rotation": (GOOD + ",qw,qx,qy\n" + "1,2,3,4,5,6,7,1,0,0\n" * 5, ":1: the rotation has qw, qx, qy, but not qz"),
    "quaternion": (GOOD + ",qw,qx,qy,qz\n" + "1,2,3,4,5,6,7,1,1,0,0\n" * 5, ":2: the quaternion has the length 1.414"),
    "twice": (GOOD.replace("q2", "q1") + "\n1,2,3,4,5,6,7" * 5, ":1: the heading 'q1' stands twice"),
    "few": (GOOD + "\n1,2,3,4,5,6,7", ":1: the table has 1 rows"),
    "joints": ("x [mm],y [mm],z [mm]\n" + "5,6,7\n" * 5, ":1: the table has no column with joint values"),
    "noise": ("# noise: small\n" + GOOD + "\n1,2,3,4,5,6,7" * 5, ":1: noise 'small': write a positive number"),
    "comment": ("# units: mm, grad\n" + GOOD + "\n1,2,3,4,5,6,7" * 5, ":1: there is no unit 'grad'"),
}


@pytest.mark.parametrize("name", sorted(BAD_POSES))
def test_a_bad_table_of_poses_is_refused_with_file_and_line(tmp_path: Path, name: str) -> None:
    text, message = BAD_POSES[name]
    file = tmp_path / "poses.csv"
    file.write_text(text)
    with pytest.raises(TwinError, match=rf"poses\.csv{message}"):
        twin.compare(file, urdf(tmp_path / "arm.urdf"))


def test_joints_of_poses_are_those_of_the_robot(tmp_path: Path) -> None:
    arm = urdf(tmp_path / "arm.urdf")
    file = tmp_path / "poses.csv"
    rows = "\n1,2,3,4,5,6,7" * 6
    file.write_text(GOOD.replace("q4 [deg],", "") + "\n1,2,3,5,6,7" * 6)
    with pytest.raises(TwinError, match=r"values of 3 joints \(q1, q2, q3\), but the tool .* by 4"):
        twin.compare(file, arm)
    file.write_text(GOOD.replace("q4 [deg]", "q4 [mm]") + rows)
    with pytest.raises(TwinError, match=r"joint 'q4' of poses\.csv is a length, but 'q4' of arm\.urdf is an angle"):
        twin.compare(file, arm)
    limited = arm.read_text().replace('"continuous"', '"revolute"')
    limits = '<axis xyz="0 0 1"/><limit lower="0.5" upper="1" effort="1" velocity="1"/>'
    arm.write_text(limited.replace('<axis xyz="0 0 1"/>', limits))
    file.write_text(GOOD + rows)
    with pytest.raises(TwinError, match=r"poses\.csv:2: joint 'q1' has no common range: 1° \.\. 1° in poses"):
        twin.compare(file, arm)
    with pytest.raises(TwinError, match="both have only poses"):
        twin.compare(file, measured(tmp_path / "other.csv"))


def test_the_column_of_a_follower_has_the_values_of_its_coupling(tmp_path: Path) -> None:
    arm = urdf(tmp_path / "arm.urdf")
    free = '<joint name="q3" type="continuous">'
    coupled = arm.read_text().replace(free, free + '<mimic joint="q2" multiplier="-1.5" offset="0.1"/>')
    arm.write_text(coupled)
    lines = [GOOD]
    for q1, q2, q4 in np.random.default_rng(4).uniform(-60, 60, (12, 3)):
        q3 = -1.5 * q2 + float(np.degrees(0.1))
        x, y, z = 1e3 * forward(np.radians([q1, q2, q3, q4]))[:3, 3]
        lines.append(",".join(f"{cell:.12g}" for cell in (q1, q2, q3, q4, x, y, z)))
    file = tmp_path / "poses.csv"
    file.write_text("\n".join(lines) + "\n")
    assert twin.compare(file, arm).verdict == "agree"
    cells = lines[5].split(",")
    cells[2] = f"{float(cells[2]) + 5:.12g}"
    lines[5] = ",".join(cells)
    file.write_text("\n".join(lines) + "\n")
    with pytest.raises(TwinError, match=r"poses\.csv:6: q3 = .*, but its coupling in arm\.urdf gives"):
        twin.compare(file, arm)


def test_units_of_poses_are_an_option_or_a_comment(tmp_path: Path) -> None:
    arm = urdf(tmp_path / "arm.urdf")
    file = measured(tmp_path / "poses.csv")
    plain = file.read_text().replace(" [deg]", "").replace(" [mm]", "")
    file.write_text(plain)
    assert twin.compare(file, arm, units="mm,deg").verdict == "agree"
    file.write_text("# units: mm, deg\n" + plain)
    assert twin.compare(file, arm).verdict == "agree"


# -- equations --------------------------------------------------------------------------------------------------


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """Return the folder of a robot whose equations are those of a table."""
    folder = tmp_path / "arm"
    source = str(table(tmp_path / "arm.csv"))
    options = ["--dh", "standard", "--units", "mm,deg", "--out", str(folder), "--quiet"]
    assert main(["new", "arm", source, *options]) == 0
    return folder


def test_equations_are_compared_with_a_file(
    robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    side = f"{robot}@equations"
    assert main(["compare", side, str(urdf(tmp_path / "arm.urdf"))]) == 0
    other = urdf(tmp_path / "long.urdf", a2=0.42)
    found = twin.compare(side, other).pairs[0]
    assert [item.joint for item in found.differences] == ["q3"]
    assert found.differences[0].shift == pytest.approx(0.02, abs=1e-9)
    assert found.differences[0].edits[0].new == "0.4"
    wrong = (robot / "formula.py").read_text().replace("mm(400", "mm(405")
    (robot / "formula.py").write_text(wrong)
    found = twin.compare(side, str(robot)).pairs[0]
    assert [item.joint for item in found.differences] == ["q3"]
    assert found.differences[0].shift == pytest.approx(0.005, abs=1e-9)
    capsys.readouterr()
    monkeypatch.setenv("TWIN_NO_CODE", "1")
    assert main(["compare", side, str(other)]) == 2
    assert "--no-code" in capsys.readouterr().err


def test_equations_are_compared_with_measured_poses(robot: Path, tmp_path: Path) -> None:
    found = twin.compare(f"{robot}@equations", measured(tmp_path / "poses.csv", noise=5e-5)).pairs[0]
    assert found.kinematics == "agree"
    assert found.poses is not None
    assert not found.poses.computed


def test_a_gear_in_the_equations_is_no_chain(robot: Path, tmp_path: Path) -> None:
    formula = robot / "formula.py"
    formula.write_text(formula.read_text().replace("q[2]", "2 * q[2]"))
    result = twin.compare(f"{robot}@equations", urdf(tmp_path / "arm.urdf"))
    assert result.verdict == "disagree"
    assert result.pairs[0].poses is not None
    assert result.pairs[0].poses.computed


INERTIAL = '<inertial pos="0 0 0" mass="0.01" diaginertia="1e-5 1e-5 1e-5"/>'


def with_finger(file: Path, *, gap: float) -> Path:
    """Write the arm as MJCF beside a parallelogram, whose pin is open along its line by `gap` in m."""
    arm = ""
    place = "0 0 0"
    turn = 0.0
    for i, (d, a, alpha) in enumerate(ROWS, 1):
        arm += f'<body name="link{i}" pos="{place}" euler="{turn!r} 0 0">{INERTIAL}<joint name="q{i}" axis="0 0 1"/>'
        place = f"{a:g} 0 {d:g}"
        turn = float(np.radians(alpha))
    arm += f'<site name="tool" pos="{place}" euler="{turn!r} 0 0"/>' + "</body>" * len(ROWS)
    finger = f"""<body name="driver" pos="1 0 0">{INERTIAL}<joint name="drive" axis="0 1 0" range="-0.8 0.8"/>
<body name="tip" pos="0.02 0 0.035">{INERTIAL}<joint name="tip_hinge" axis="0 1 0"/>
<site name="on_tip" pos="-0.02 0 0.004"/></body></body>
<body name="rocker" pos="0.98 0 0.004">{INERTIAL}<joint name="rocker_hinge" axis="0 1 0"/>
<site name="on_rocker" pos="0.02 {gap} 0.035"/></body>"""
    drives = "".join(f'<position joint="q{i}"/>' for i in range(1, len(ROWS) + 1))
    file.write_text(
        '<mujoco><compiler angle="radian" autolimits="true"/>'
        f'<worldbody><body name="base">{INERTIAL}{arm}{finger}</body></worldbody>'
        '<equality><connect name="pin" site1="on_tip" site2="on_rocker"/></equality>'
        f"<actuator>{drives}</actuator></mujoco>",
        encoding="utf-8",
    )
    return file


def test_an_open_loop_beside_the_tool_disagrees_with_equations(robot: Path, tmp_path: Path) -> None:
    side = f"{robot}@equations"
    result = twin.compare(with_finger(tmp_path / "open.xml", gap=0.0005), side)
    assert result.verdict == "disagree"
    (item,) = result.pairs[0].differences
    assert item.text.startswith("joint 'pin' does not close its loop")
    assert item.shift == pytest.approx(0.0005, rel=1e-6)
    # the poses of the tool agree all the same
    assert "compare.poses" not in [finding.code for finding in result.findings]
    result = twin.compare(with_finger(tmp_path / "closed.xml", gap=0.0), side)
    assert result.verdict == "agree"
    assert result.pairs[0].uncompared == ("drive", "tip_hinge", "rocker_hinge", "pin")
    (finding,) = result.findings
    assert finding.code == "compare.uncompared"
    assert "'rocker_hinge'" in finding.message


@pytest.mark.slow
def test_inverse_equations_are_compared_by_the_poses_of_the_closed_loops() -> None:
    found = twin.compare("sils@equations", "sils").pairs[0]
    assert found.kinematics == "agree"
    assert found.poses is not None
    assert found.poses.computed
    assert found.poses.distance < 1e-9


def test_names_of_equations_are_checked(robot: Path, tmp_path: Path) -> None:
    arm = urdf(tmp_path / "arm.urdf")
    with pytest.raises(TwinError, match="q9"):
        twin.compare(f"{robot}@equations", arm, only=["q9"])
    only = ["q1", "q2"]
    assert twin.compare(f"{robot}@equations", arm, only=only).pairs[0].agrees
