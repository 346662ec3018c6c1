"""Certificates of bounds along protocols: a script and the audit check them without the prover."""

from __future__ import annotations

import json
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import twin
from made.certificates import audited, digest, require_refusal, require_short
from made.scripts import script
from twin.api.motion_proof import prove_motion

SCRIPT = Path(__file__).parents[2] / "docs/check_motion.py"

pytestmark = pytest.mark.slow


def _protocols():
    found = []
    for robot in twin.names():
        files = twin.load(robot).files
        assert files is not None
        found += [(robot, name) for name in files.protocols()]
    return found


PROTOCOLS = _protocols()

SHORT = {
    ("davinci_ecm", "look_around"),
    ("davinci_psm_si", "reach"),
    ("lapbot", "cavity"),
    ("pa10", "circle"),
    ("sils", "table2"),
}
"""Protocols of the slow lane: loops, couplings, neither. The others are those of the nightly lane."""

DRAWN = [names if names in SHORT else pytest.param(*names, marks=pytest.mark.nightly) for names in PROTOCOLS]


@pytest.fixture(scope="module")
def checker():
    return script("docs/check_motion.py")


@cache
def proved(robot, protocol):
    """Return the certificate of a protocol as text."""
    return json.dumps(prove_motion(twin.load(robot), protocol, clearance=False).certificate)


@pytest.fixture
def certificate():
    """The certificate of the shortest protocol with loops."""
    return json.loads(proved("davinci_ecm", "look_around"))


def checked(checker, path, data, pieces="2"):
    """Return the exit code of the script for a certificate with a new hash."""
    data["sha256"] = digest(data)
    path.write_text(json.dumps(data))
    return checker.main([str(path), pieces] if pieces else [str(path)])


def changed(certificate, kind, value):
    """Return the bound of a certificate with a kind and a name."""
    (row,) = [row for row in certificate["bounds"] if (row["kind"], row["value"]) == (kind, value)]
    return row


def test_the_script_is_short_and_needs_the_standard_library_alone(checker):
    require_short(checker)


@pytest.mark.parametrize(("robot", "protocol"), DRAWN)
def test_bounds_of_every_protocol_hold_on_drawn_pieces(tmp_path, checker, capsys, robot, protocol):
    data = json.loads(proved(robot, protocol))
    assert checked(checker, tmp_path / "c.json", data) == 0
    assert capsys.readouterr().out.startswith(f"holds: {len(data['bounds'])} bounds on ")
    code, report = audited(tmp_path / "c.json", data, capsys)
    assert code == 0
    assert {check["where"] for check in report["checks"]} >= {"predictions", "loops"}


@pytest.mark.nightly
@pytest.mark.parametrize(("robot", "protocol"), PROTOCOLS)
def test_bounds_of_every_protocol_hold_on_all_pieces(tmp_path, checker, robot, protocol):
    assert checked(checker, tmp_path / "c.json", json.loads(proved(robot, protocol)), "") == 0


def test_all_pieces_hold_for_the_script_alone(tmp_path):
    path = tmp_path / "c.json"
    path.write_text(proved("davinci_ecm", "look_around"))
    line = [sys.executable, "-I", str(SCRIPT), str(path)]
    done = subprocess.run(line, capture_output=True, text=True, timeout=300, check=False)
    pieces = len(json.loads(path.read_text())["pieces"])
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"holds: 19 bounds on {pieces} of {pieces} pieces\n"


def test_the_audit_with_a_robot_compares_path_joints_and_samples(tmp_path, capsys):
    path = tmp_path / "c.json"
    certificate = json.loads(proved("sils", "table2"))
    code, report = audited(path, certificate, capsys, "--robot", "sils")
    assert code == 0
    assert "table2" in {check["where"] for check in report["checks"]}
    certificate["path"]["phases"][0]["series"][0][0] += 1e-6
    certificate["sha256"] = digest(certificate)
    _, report = audited(path, certificate, capsys, "--robot", "sils")
    assert "phase 'approach' is not that of the plan" in str(report["findings"])
    certificate = json.loads(proved("sils", "table2"))
    certificate["mechanism"]["tree"][3]["on_parent"][0][3] += 1e-12
    certificate["sha256"] = digest(certificate)
    code, report = audited(path, certificate, capsys, "--robot", "sils")
    assert code != 0
    assert "is not that of the CAD" in str(report["findings"])


@pytest.mark.parametrize("seed", range(50))
def test_what_was_changed_is_refused(tmp_path, checker, certificate, capsys, seed):
    require_refusal(checker, certificate, tmp_path / "c.json", capsys, seed)


@pytest.mark.parametrize(
    ("kind", "value", "change"),
    [
        pytest.param("joint limit", "q1", 1.01, marks=pytest.mark.nightly),
        pytest.param("joint speed", "q3", 0.99, marks=pytest.mark.nightly),
        pytest.param("passive limit", "pin_a3", 1.01, marks=pytest.mark.nightly),
        ("RCM", "enforced", -1e-6),
        pytest.param("tool speed", "tip", 0.99, marks=pytest.mark.nightly),
        pytest.param("tool speed", "rotation", 0.99, marks=pytest.mark.nightly),
        pytest.param("loop gap", "loops", 1e-6, marks=pytest.mark.nightly),
    ],
)
def test_a_bound_that_was_made_sharper_fails(tmp_path, checker, certificate, capsys, kind, value, change):
    row = changed(certificate, kind, value)
    key = "at least" if "at least" in row else "at most"
    row[key] = change if kind == "RCM" else row[key] * change
    assert checked(checker, tmp_path / "c.json", certificate, "") == 1
    assert f"{kind} {value}" in capsys.readouterr().out
    if kind != "loop gap":  # Newton's method closes the loops better than the enclosure says
        assert audited(tmp_path / "c.json", certificate, capsys)[0] == 1


def beyond_limit(data):
    changed(data, "joint limit", "q1")["at least"] = -0.5


def other_path(data):
    """A joint moves 50 mm farther: limits or the RCM are exceeded, or the loops do not close."""
    data["path"]["phases"][1]["series"][0][1] += 0.05


def faster(data):
    phase = data["path"]["phases"][0]
    phase["rates"] = [2 * rate for rate in phase["rates"]]


def other_length(data):
    data["mechanism"]["loops"][-1]["on_parent"][0][3] += 0.01


def other_prediction(data):
    for piece in data["pieces"]:
        piece[3][0][0] += 1e-3


def other_assembly(data):
    """From the middle on, one joint is predicted a full turn further: it does not go on from piece to piece."""
    for piece in data["pieces"][40:]:
        piece[3][0][0] += 6.283185307179586


def piece_left_out(data):
    del data["pieces"][20]


def first_pieces(data):
    """Only the first piece of each phase is left."""
    seen = set()
    data["pieces"] = [piece for piece in data["pieces"] if not (piece[0] in seen or seen.add(piece[0]))]


def determinant_alone(data):
    """Its bound does not rest on predictions: nothing is proved of the bodies."""
    data["bounds"] = [row for row in data["bounds"] if row["kind"] == "determinant"]
    for piece in data["pieces"]:
        piece[3:] = None, None


def no_bound(data):
    data["bounds"] = []


def unknown_bound(data):
    data["bounds"][0]["kind"] = "weight"
    del data["bounds"][0]["weights"], data["bounds"][0]["limits"]


def grid_left_out(data):
    phase = data["path"]["phases"][0]
    phase["grid"] = phase["grid"][:-20]
    phase["rates"] = phase["rates"][:-20]


def not_finite(data):
    data["pieces"][3][3][0][0] = float("nan")


def no_matrix(data):
    data["pieces"][3][4] = [[0.0 for _ in row] for row in data["pieces"][3][4]]


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(beyond_limit, marks=pytest.mark.nightly),
        pytest.param(other_path, marks=pytest.mark.nightly),
        pytest.param(faster, marks=pytest.mark.nightly),
        other_length,
        other_prediction,
        other_assembly,
        piece_left_out,
        first_pieces,
        determinant_alone,
        no_bound,
        unknown_bound,
        grid_left_out,
        not_finite,
        no_matrix,
    ],
)
def test_what_was_changed_with_a_new_hash_is_refused(tmp_path, checker, certificate, change):
    change(certificate)
    assert checked(checker, tmp_path / "c.json", certificate, "") in (1, 2)


@pytest.mark.parametrize("change", [piece_left_out, first_pieces, determinant_alone, no_bound])
def test_the_audit_refuses_what_leaves_nothing_to_sample(tmp_path, certificate, capsys, change):
    change(certificate)
    certificate["sha256"] = digest(certificate)
    code, report = audited(tmp_path / "c.json", certificate, capsys)
    assert code == 2
    assert "certificate.unreadable" in str(report["findings"])


def test_arithmetic_contains_functions_at_random_places(checker):
    """A composition of all operations is inside its bound, computed with 40 digits; derivatives as well."""
    import random

    import mpmath

    mpmath.mp.dps = 40
    generator = random.Random(3)
    for _ in range(40):
        c = [generator.gauss(0, 1) * 0.3**k for k in range(6)]
        f = checker.Model(c, 0.0, {0: checker.ONE})
        s, cosine = f.sine_cosine()
        model = checker.linear([0.3, -1.7], [s * cosine, f * f * s])
        a, b = sorted(generator.uniform(-1, 1) for _ in range(2))
        low, high = model.ends(a, b)
        for _ in range(10):
            x = generator.uniform(a, b)
            z = sum(mpmath.mpf(ck) * mpmath.mpf(x) ** k for k, ck in enumerate(c))
            exact = mpmath.mpf(0.3) * mpmath.sin(z) * mpmath.cos(z) - mpmath.mpf(1.7) * z * z * mpmath.sin(z)
            slope = mpmath.mpf(0.3) * mpmath.cos(2 * z)
            slope -= mpmath.mpf(1.7) * (2 * z * mpmath.sin(z) + z * z * mpmath.cos(z))
            for g, value in ((model, exact), (model.d[0], slope)):
                polynomial = sum(mpmath.mpf(ck) * mpmath.mpf(x) ** k for k, ck in enumerate(g.c))
                assert abs(polynomial - value) <= g.r
            assert low <= exact <= high
