"""Seeded defects in tracks, MJCF, URDF, Unity packages and proofs: each is one small edit of a good bundle."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import twin.exchange.audit
from made import bundle as base
from twin.core.version import __version__
from twin.exchange.audit import audit
from twin.exchange.audit.clip_comparison import _report_files_without_motion, _report_missing_clips
from twin.exchange.audit.clip_references import Reference
from twin.exchange.audit.file_content import Content, FileClip
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.poses import about, pose
from twin.exchange.audit.proof_hashes import check_proof
from twin.exchange.audit.proof_statements import check_statements
from twin.exchange.audit.repeated_checks import _EXPORT_CODES, _repeats
from twin.exchange.audit.sampled_states import CLIP
from twin.exchange.audit.track_claims import check_proof_clips
from twin.exchange.formats.tracks.audit.rcm import check_rcm


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    return base.write_good(tmp_path_factory.mktemp("good") / "bars")


@pytest.fixture
def bundle(good, tmp_path):
    """Return a copy of the good bundle with some of its files, and a new proof once it is spoilt."""

    def copy(spoil, *names: str, proof: bool = True) -> Path:
        folder = tmp_path / "bars"
        for name in names:
            (shutil.copytree if (good / name).is_dir() else shutil.copy)(good / name, _made(folder / name))
        if not proof:
            base.write_proof(folder)
        spoil(folder)
        if proof:
            base.write_proof(folder)
        return folder

    return copy


def _made(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def codes(folder: Path) -> set[str]:
    return {f.code for f in base.grave(audit(folder).findings)}


# ------------------------------------------------------------------------------------------------------ tracks


def track(change):
    """Return an edit of the track's data."""

    def edit(folder):
        file = folder / "tracks/swing.json"
        data = json.loads(file.read_text())
        change(data)
        file.write_text(json.dumps(data))

    return edit


def poses(change):
    """Return an edit of the poses (frames, links, 7) of a track."""

    def edit(data):
        rows = np.array(data["poses"]).reshape(data["frames"], len(data["links"]), 7)
        change(rows, data["links"])
        data["poses"] = rows.ravel().tolist()

    return track(edit)


def _flip(rows, links):
    rows[9, links.index("rocker"), 3:] *= -1


def _wxyz(rows, links):
    rows[..., 3:] = rows[..., [6, 3, 4, 5]].copy()


def _millimetres(rows, links):
    rows[..., :3] *= 1000


def _mirrored(rows, links):
    rows[..., [1, 3, 5]] *= -1


def _swapped(rows, links):
    a, b = links.index("crank"), links.index("rocker")
    rows[:, [a, b]] = rows[:, [b, a]]


def _not_unit(rows, links):
    rows[9, 1, 3:] *= 1.01


def _off(rows, links):
    rows[9, links.index("rocker"), 0] += 2e-6


def _y_up(rows, links):
    rows[..., [1, 2]] = rows[..., [2, 1]] * [1, -1]
    half = np.sqrt(0.5)
    x, y, z, w = (rows[..., i].copy() for i in (3, 4, 5, 6))
    rows[..., 3:] = half * np.stack([x - w, y + z, z - y, w + x], axis=-1)


def _degrees(data):
    data["positions"] = np.degrees(data["positions"]).tolist()


def _late(data):
    data["phase_end"][1] = 2.5


def _disordered(data):
    data["phase_start"][1] = 0.4


def _other_times(data):
    data["times"] = [t * 2 for t in data["times"]]
    data["phase_start"], data["phase_end"] = ([2 * t for t in data[k]] for k in ("phase_start", "phase_end"))
    data["rate"] /= 2


def _rcm(data, enforced=(1, 0)):
    data["frame_names"] = ["shaft"]
    data["frame_links"] = [data["tool_link"]]
    data["frames_local"] = [0.0, 0, 0, 0, 0, 0, 1]
    data["phase_has_rcm"] = [1, 0]
    data["phase_rcm"] = [0.0] * 6
    seven = np.array(data["poses"]).reshape(data["frames"], -1, 7)[0, data["links"].index(data["tool_link"])]
    data["phase_rcm"][:3] = seven[:3].tolist()
    data["phase_rcm_enforced"] = list(enforced)


def swapped_times(data):
    data["times"][9], data["times"][10] = data["times"][10], data["times"][9]


TRACKS = {
    "sign flip": (poses(_flip), "tracks.quaternion_sign"),
    "wxyz order": (poses(_wxyz), "compare.odd_one_out"),
    "millimetres": (poses(_millimetres), "tracks.size"),
    "mirrored frame": (poses(_mirrored), "compare.odd_one_out"),
    "swapped links": (poses(_swapped), "compare.odd_one_out"),
    "y up": (poses(_y_up), "compare.odd_one_out"),
    "quaternion not unit": (poses(_not_unit), "tracks.quaternion"),
    "one key off by 2 um": (poses(_off), "compare.odd_one_out"),
    "degrees for radians": (track(_degrees), "tracks.limits"),
    "limits breached": (track(lambda d: d["joint_upper"].__setitem__(0, 0.1)), "tracks.limits"),
    "limits swapped": (track(lambda d: d["joint_upper"].__setitem__(0, -4.0)), "tracks.limits"),
    "times do not increase": (track(swapped_times), "tracks.times"),
    "frame rate": (track(lambda d: d.update(rate=60.0)), "tracks.rate"),
    "twice as long": (track(_other_times), "compare.times"),
    "poses cut off": (track(lambda d: d["poses"].pop()), "tracks.shape"),
    "positions cut off": (track(lambda d: d["positions"].pop()), "tracks.shape"),
    "joint types cut off": (track(lambda d: d["joint_types"].pop()), "tracks.shape"),
    "frames": (track(lambda d: d.update(frames=40)), "tracks.shape"),
    "phase beyond the end": (track(_late), "tracks.phases"),
    "phases overlap": (track(_disordered), "tracks.phases"),
    "length unit": (track(lambda d: d.update(length_unit="mm")), "tracks.convention"),
    "quaternion order": (track(lambda d: d.update(quaternion_order="wxyz")), "tracks.convention"),
    "frame": (track(lambda d: d.update(frame="y-up left-handed")), "tracks.convention"),
    "not finite": (track(lambda d: d["positions"].__setitem__(5, float("nan"))), "tracks.finite"),
    "link twice": (track(lambda d: d["links"].__setitem__(1, d["links"][0])), "tracks.duplicate_name"),
    "link renamed": (track(lambda d: d["links"].__setitem__(1, "lever")), "compare.missing_link"),
    "model hash": (track(lambda d: d.update(model_hash="sha256:0")), "compare.model_hash"),
    "nested arrays": (track(lambda d: d.update(poses=[d["poses"]])), "tracks.unreadable"),
    "RCM missed": (track(_rcm), "tracks.rcm"),
    "shaft axis of length 2": (track(lambda d: (_rcm(d), d.update(shaft_axis=[0, 0, 2]))), "tracks.shape"),
    "said of too few phases whether the RCM is kept": (track(lambda d: _rcm(d, [1])), "tracks.shape"),
}


@pytest.mark.parametrize("name", TRACKS)
def test_defects_of_tracks(name, bundle):
    spoil, code = TRACKS[name]
    # which of two is wrong nobody can say
    others = ["bars.glb", "bars_ar.usdz"] if code == "compare.odd_one_out" else ["bars.glb"]
    report = audit(bundle(spoil, "tracks", *others))
    found = [f for f in base.grave(report.findings) if f.code == code]
    assert found, [(f.code, f.message) for f in report.findings]
    assert report.exit_code > 0 or name == "model hash"
    if code == "compare.odd_one_out":
        assert found[0].where == "tracks/swing.json: swing"
        assert "this file is wrong" in found[0].message


def _unsaid(data):
    _rcm(data)
    del data["phase_rcm_enforced"]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (_rcm, [("tracks.rcm", "disagreement")]),
        (lambda data: _rcm(data, (0, 0)), []),
        (_unsaid, [("tracks.rcm_watched", "info")]),
    ],
)
def test_a_shaft_may_pass_an_rcm_that_is_only_watched(change, told, bundle):
    report = audit(bundle(track(change), "tracks/swing.json"))
    assert [(f.code, f.severity) for f in report.findings if f.code.startswith("tracks.rcm")] == told


@pytest.mark.parametrize(("off", "told"), [(0.5e-3, [(500.0, 100.0)]), (0.05e-3, [])])
def test_an_rcm_beside_the_centre_of_rotation_is_measured_against_its_limit(off, told):
    centre = np.array([0.1, 0.2, 0.3])
    turns = about([1, 0, 0], np.linspace(0, 0.5, 5))
    T = pose(turns, centre - 0.05 * turns[:, :, 2])
    data = {
        "phases": ["pivot"],
        "phase_start": [0],
        "phase_end": [1],
        "phase_has_rcm": [1],
        "phase_rcm": np.add(centre, [off, 0, 0]).tolist(),
        "phase_rcm_enforced": [0],
        "frame_names": ["tip"],
        "frame_links": ["tool"],
        "tool_link": "tool",
        "moved_frame": "tip",
    }
    ledger = Ledger("swing.json")
    check_rcm(data, FileClip("swing", np.linspace(0, 1, 5), {"tool": T}), np.array([0.0, 0, 0, 0, 0, 0, 1]), ledger)
    assert [(round(f.size, 6), f.limit) for f in ledger.findings] == told


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("wxyz order", "read w, x, y, z"),
        ("mirrored frame", "the frame is mirrored (left-handed): y has the opposite sign"),
        ("swapped links", "'crank' and 'rocker' are swapped"),
        ("millimetres", "millimetres"),
        ("y up", "up axis is wrong"),
        ("degrees for radians", "as a value in degrees, it would be within the limits"),
    ],
)
def test_the_mistake_is_guessed(name, reason, bundle):
    messages = [f.message for f in audit(bundle(TRACKS[name][0], "tracks", "bars.glb", "bars_ar.usdz")).findings]
    assert any(reason in m for m in messages), messages


def test_csv_is_held_against_json(bundle):
    def spoil(folder):
        file = folder / "tracks/swing.csv"
        lines = file.read_text().splitlines()
        cells = lines[-5].split(",")
        cells[-7] = f"{float(cells[-7]) + 3e-6:.7f}"
        file.write_text("\n".join([*lines[:-5], ",".join(cells), *lines[-4:]]) + "\n")

    assert codes(bundle(spoil, "tracks")) == {"compare.pose"}


def test_columns_of_csv_are_those_of_its_links(bundle):
    def spoil(folder):
        file = folder / "tracks/swing.csv"
        file.write_text(file.read_text().replace("rocker_x_m,rocker_y_m", "rocker_y_m,rocker_x_m", 1))

    assert codes(bundle(spoil, "tracks")) == {"tracks.columns"}


# --------------------------------------------------------------------------------------------- MJCF and URDF


def text_of(name: str, pattern: str, new: str, *, every: bool = False):
    """Return an edit that replaces the first match of a pattern in a file, or every one."""

    def edit(folder):
        file = folder / name
        text = file.read_text()
        spoilt, count = re.subn(pattern, new, text, count=0 if every else 1, flags=re.DOTALL)
        assert count, f"{pattern} is not in {name}"
        file.write_text(spoilt)

    return edit


def _lost_mesh(folder):
    next((folder / "meshes").glob("rocker*.obj")).unlink()


def _turned_mesh(folder):
    file = next((folder / "meshes").glob("rocker*.obj"))
    lines = file.read_text().splitlines()
    turned = [" ".join(["f", *reversed(line.split()[1:])]) if line.startswith("f ") else line for line in lines]
    file.write_text("\n".join(turned) + "\n")


def _big_mesh(folder):
    for name in ("bars.xml", "bars.urdf"):
        file = folder / name
        file.write_text(file.read_text().replace("0.001 0.001 0.001", "1 1 1"))


TREES = {
    "MJCF: axis turned": (
        text_of("bars.xml", r'name="elbow"([^>]*)axis="0 0 1"', r'name="elbow"\1axis="0 0 -1"'),
        "compare.pose",
    ),
    "MJCF: body moved": (text_of("bars.xml", r'(<body name="coupler" pos=")0?\.?1 ', r"\g<1>0.1001 "), "compare.pose"),
    "MJCF: anchor moved": (
        text_of("bars.xml", r'(<connect name="closing_0"[^>]*anchor=")0\.22 ', r"\g<1>0.2201 "),
        "mjcf.loop",
    ),
    "MJCF: limits": (text_of("bars.xml", r'range="-2\.9\d* 3\.0\d*"', 'range="-1 1"'), "mjcf.limits"),
    "MJCF: degrees": (text_of("bars.xml", 'angle="radian"', 'angle="degree"'), "mjcf.limits"),
    "MJCF: body renamed": (text_of("bars.xml", '="coupler"', '="lever"', every=True), "compare.missing_link"),
    "MJCF: no XML": (text_of("bars.xml", "</mujoco>", ""), "mjcf.unreadable"),
    "URDF: axis turned": (text_of("bars.urdf", r'(name="elbow".*?axis xyz=")0 0 1', r"\g<1>0 0 -1"), "compare.pose"),
    "URDF: origin moved": (
        text_of("bars.urdf", r'(name="elbow".*?origin xyz=")0\.1 ', r"\g<1>0.1001 "),
        "compare.pose",
    ),
    "URDF: axis not unit": (text_of("bars.urdf", r'(name="elbow".*?axis xyz=")0 0 1', r"\g<1>0 0 2"), "urdf.axis"),
    "URDF: limits": (text_of("bars.urdf", r'lower="-2\.9\d*"', 'lower="-1.0"'), "urdf.limits"),
    "URDF: link unknown": (text_of("bars.urdf", 'child link="coupler"', 'child link="lever"'), "urdf.unreadable"),
    "URDF: entities": (text_of("bars.urdf", "<robot", '<!DOCTYPE r [<!ENTITY a "b">]><robot'), "urdf.unreadable"),
    "mesh lost": (_lost_mesh, "urdf.mesh"),
    "mesh inside out": (_turned_mesh, "urdf.winding"),
    "mesh in metres": (_big_mesh, "compare.shape"),
}


@pytest.mark.parametrize("name", TREES)
def test_defects_of_trees(name, bundle):
    spoil, code = TREES[name]
    folder = bundle(spoil, "tracks", "bars.glb", "bars.xml", "bars.urdf", "meshes")
    assert code in codes(folder), [(f.code, f.message) for f in audit(folder).findings]


# ------------------------------------------------------------------------------------------------------- Unity


def _guid_twice(folder):
    first, second = sorted((folder / "unity").rglob("*.meta"))[:2]
    second.write_text(first.read_text())


UNITY = {
    "missing .meta": (lambda f: (f / "unity/Runtime/Player.cs.meta").unlink(), "unity.meta_missing"),
    "missing .meta of a folder": (lambda f: (f / "unity/Runtime.meta").unlink(), "unity.meta_missing"),
    "duplicate GUID": (_guid_twice, "unity.guid_twice"),
    "no GUID": (lambda f: (f / "unity/Runtime.meta").write_text("guid: 12\n"), "unity.guid"),
    "orphan .meta": (lambda f: (f / "unity/Runtime/Player.cs").unlink(), "unity.meta_orphan"),
    "no scripts": (lambda f: [p.unlink() for p in (f / "unity").rglob("*.cs*")], "unity.scripts"),
    "package.json": (text_of("unity/package.json", '"displayName": "Small", ', ""), "unity.package"),
    "package name": (text_of("unity/package.json", "com.twin.small", "Small"), "unity.package"),
    "JSON": (text_of("unity/package.json", "}", ""), "unity.json"),
    "sample": (text_of("unity/package.json", "}", ', "samples": [{"path": "Samples~/None"}]}'), "unity.sample"),
    "editor in builds": (
        text_of("unity/Editor/Small.Editor.asmdef", ', "includePlatforms": ."Editor".', ""),
        "unity.asmdef",
    ),
    "reference": (text_of("unity/Editor/Small.Editor.asmdef", r'\["Small"\]', '["Small.Gone"]'), "unity.asmdef"),
    "component's file": (text_of("unity/Runtime/Player.cs", "class Player", "class Actor"), "unity.script"),
    "UnityEditor in a build": (
        text_of("unity/Runtime/Player.cs", "public", "using UnityEditor; public"),
        "unity.script",
    ),
}


@pytest.mark.parametrize("name", UNITY)
def test_defects_of_a_unity_package(name, bundle):
    spoil, code = UNITY[name]
    folder = bundle(spoil, "unity")
    assert code in codes(folder), [(f.code, f.message) for f in audit(folder).findings]


def test_a_package_is_audited_as_one_from_inside_its_folder(bundle, monkeypatch):
    folder = bundle(UNITY["missing .meta"][0], "unity")
    monkeypatch.chdir(folder / "unity")
    assert "unity.meta_missing" in codes(Path())


# ------------------------------------------------------------------------------------------------------- proof


def _byte(folder):
    data = bytearray((folder / "bars.glb").read_bytes())
    data[-1] ^= 1
    (folder / "bars.glb").write_bytes(data)


PROOF = {
    "a byte changed": (_byte, "proof.hash"),
    "wrong hash": (text_of("proof.json", r'("bars.glb", "sha256": )"....', r'\1"0000'), "proof.hash"),
    "file lost": (lambda f: (f / "tracks/swing.csv").unlink(), "proof.missing"),
    "file slipped in": (lambda f: (f / "more.txt").write_text("?"), "proof.unlisted"),
    "verdict": (text_of("proof.json", r'("verdict": )"agree"}$', r'\1"disagree"}'), "proof.verdict"),
    "outside": (text_of("proof.json", '"file": "bars.glb"', '"file": "../../etc/hosts"'), "proof.file"),
    "schema": (text_of("proof.json", "twin-proof", "proof"), "proof.schema"),
    "cut off": (text_of("proof.json", "}$", ""), "proof.unreadable"),
}


@pytest.mark.parametrize("name", PROOF)
def test_defects_of_a_proof(name, bundle):
    spoil, code = PROOF[name]
    folder = bundle(spoil, "tracks", "bars.glb", proof=False)
    assert code in codes(folder), [(f.code, f.message) for f in audit(folder).findings]


def test_drawn_states_are_no_motion_that_files_lack():
    moving = np.stack([np.eye(4), pose(np.eye(3), [0.1, 0, 0])])
    swing = FileClip("swing", np.arange(2.0), {"bar": moving})
    ref = Reference(swing, "the tracks")
    playing = Content(Ledger("bars.glb"), "glb", [swing], declared=("bar",))
    silent = Content(Ledger("still.glb"), "glb", declared=("bar",))
    _report_missing_clips([playing], {"swing": ref, CLIP: ref})
    _report_files_without_motion([silent], {CLIP: ref})
    assert not playing.ledger.found
    assert not silent.ledger.found
    _report_missing_clips([playing], {"swing": ref, "another": ref})
    _report_files_without_motion([silent], {"another": ref})
    assert [f.code for f in playing.ledger.found] == ["compare.missing_clip"]
    assert [f.code for f in silent.ledger.found] == ["compare.no_motion"]


STATED = {
    "another robot": (text_of("proof.json", '"robot": "bars"', '"robot": "stars"'), "proof.robot"),
    "another model": (text_of("proof.json", '"sha256:....', '"sha256:0000'), "proof.model_hash"),
    "made by no twin": (text_of("proof.json", '"twin 0.0.1"', '"twin"'), "proof.made_by"),
    "no motions": (text_of("proof.json", '"clips": ', '"klips": '), "proof.schema"),
    "size of a file": (text_of("proof.json", '"bytes": ', '"bytes": 1'), "proof.bytes"),
    "a file twice": (text_of("proof.json", r'("files": \[)({.*?})', r"\1\2, \2"), "proof.doubled"),
    "an entry twice": (text_of("proof.json", '"version": 1', '"version": 1, "version": 1'), "proof.doubled"),
    "hash of an input": (text_of("proof.json", '"0000', '"000'), "proof.input"),
    "another motion": (text_of("proof.json", '"protocol": "swing"', '"protocol": "wing"'), "proof.clip"),
    "budget of a motion": (text_of("proof.json", '"worst": ', '"worst": 1'), "proof.clip"),
    "unit of a check": (text_of("proof.json", '"unit": "rad"', '"unit": "m"'), "proof.check"),
    "a check that fails": (
        text_of("proof.json", '"verdict": "agree", "where"', '"verdict": "disagree", "where"'),
        "proof.check",
    ),
    "verdict against findings": (
        text_of("proof.json", r'"findings": \[', '"findings": [{"severity": "error", "code": "x", "message": "y"}'),
        "proof.verdict",
    ),
}


@pytest.fixture(scope="module")
def proven(good, tmp_path_factory):
    """Return (folder, contents, checks): a folder with a proof, and what the audit reads in it beside the proof."""
    folder = tmp_path_factory.mktemp("proven")
    shutil.copytree(good / "tracks", folder / "tracks")
    shutil.copy(good / "bars.glb", folder)
    base.write_proof(folder)
    read = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(twin.exchange.audit, "check_statements", lambda *given: read.append(given))
        audit(folder)
    ((_, _, contents, checks, _),) = read
    return folder, contents, checks


@pytest.mark.parametrize("name", STATED)
def test_defects_of_what_a_proof_states(name, proven):
    spoil, code = STATED[name]
    folder, contents, checks = proven
    base.write_proof(folder)
    spoil(folder)
    ledger = Ledger("proof.json")
    check_statements(check_proof(folder / "proof.json", ledger), folder, contents, checks, ledger)
    check_proof_clips(json.loads((folder / "proof.json").read_text()), contents, ledger)
    assert code in {f.code for f in ledger.found}, [(f.code, f.message) for f in ledger.found]


def test_a_proof_repeats_the_checks_of_its_own_version(proven):
    """The proof of this twin must have the checks that it makes; here it has only those of the writer."""
    folder, contents, checks = proven
    base.write_proof(folder)
    text_of("proof.json", r"0\.0\.1", __version__, every=True)(folder)
    ledger = Ledger("proof.json")
    check_statements(check_proof(folder / "proof.json", ledger), folder, contents, checks, ledger)
    assert any("lacks the check" in f.message for f in ledger.found)


def _largest(proof, check):
    """Return the check of a proof that begins with `check`, has a place, and is the largest."""
    rows = [row for row in proof["checks"] if row["check"].startswith(check) and row["where"] and row["worst"]]
    return max(rows, key=lambda row: row["worst"])


def _finding(**entries):
    nothing = {"when": "", "size": None, "unit": "", "limit": None, "suggestion": "", "cause": "", "severity": "info"}
    left_out = {
        "code": "export.left_out",
        "message": "bars.urdf: the format cannot hold the cones of pin",
        "where": "pin",
    }
    return {**nothing, **left_out, **entries}


REPEATED = {
    "nothing": (lambda proof: proof["findings"].append(_finding()), ""),
    "no place": (lambda proof: _largest(proof, "clip").update(where=""), "is stated as"),
    "another sign": (lambda proof: _largest(proof, "clip").update(worst=-1e-9), "is stated as"),
    "place of no file": (lambda proof: _largest(proof, "clip").update(where="crankx"), "crankx"),
    "time of no motion": (lambda proof: _largest(proof, "clip").update(when="t = 77 s"), "t = 77 s"),
    "check gone": (lambda proof: proof["checks"].remove(_largest(proof, "clip")), "lacks the check"),
    "time that is no number": (lambda proof: _largest(proof, "clip").update(when="t = 1.2.3 s"), "t = 1.2.3 s"),
    "code of no finding": (lambda proof: proof["findings"].append(_finding(code="export.leftout")), "export.leftout"),
    "place that no message names": (lambda proof: proof["findings"].append(_finding(where="rod")), "'rod'"),
    "cause of what has none": (lambda proof: proof["findings"].append(_finding(cause="rust")), "cause 'rust'"),
    "protocol of a motion": (lambda proof: proof["inputs"].append({"file": "trajectories/a.toml"}), "'swing.toml'"),
}


@pytest.mark.parametrize("name", REPEATED)
def test_what_a_proof_of_this_version_repeats(name, proven):
    """A proof with all checks of this audit has no finding; one that states another place, time or finding has."""
    folder, contents, checks = proven
    edit, said = REPEATED[name]
    base.write_proof(folder)
    file = folder / "proof.json"
    proof = json.loads(file.read_text().replace(base.OTHER_VERSION, __version__))
    proof["inputs"] = []
    proof["checks"] += [check.as_dict() for check in checks if check.file != "proof.json"]
    edit(proof)
    file.write_text(json.dumps(proof))
    ledger = Ledger("proof.json")
    check_statements(check_proof(file, ledger), folder, contents, checks, ledger)
    messages = [finding.message for finding in ledger.found]
    if said:
        assert any(said in message for message in messages), messages
    else:
        assert not messages


def test_a_check_is_repeated_with_another_version_of_a_library(proven):
    """Another machine may have another usd-core; a format of the project's own has its version everywhere."""
    check = proven[2][0]
    for tool, is_repeated in (("twin.exchange.audit on usd-core", True), ("twin.exchange.audit tracks", False)):
        own = replace(check, tool=tool, version="26.11")
        assert _repeats(own.as_dict(), own)
        assert _repeats(own.as_dict() | {"version": "26.5"}, own) is is_repeated


def test_the_codes_of_an_export_are_those_of_its_writers():
    """The audit imports no writer, so that its list of their codes is compared here."""
    package = Path(twin.__file__).parent
    codes = set()
    for file in (
        *package.glob("exchange/write/*.py"),
        *package.glob("exchange/formats/*/write/*.py"),
        *package.glob("exchange/formats/*/write.py"),
        package / "api" / "scene_export.py",
    ):
        codes.update(re.findall(r'"(export\.[a-z_]+)"', file.read_text()))
    assert codes == set(_EXPORT_CODES)


def test_inputs_that_are_not_beside_others_are_named(proven):
    """An export has none of its inputs beside it, which is no finding."""
    folder, contents, checks = proven
    base.write_proof(folder)
    ledger = Ledger("proof.json")
    check_statements(check_proof(folder / "proof.json", ledger), folder, contents, checks, ledger)
    assert not ledger.found
    file = folder / "proof.json"
    proof = json.loads(file.read_text())
    glb = next(row for row in proof["files"] if row["file"] == "bars.glb")
    proof["inputs"].append({"file": "bars.glb", "sha256": glb["sha256"]})
    file.write_text(json.dumps(proof))
    ledger = Ledger("proof.json")
    check_statements(check_proof(folder / "proof.json", ledger), folder, contents, checks, ledger)
    (absent,) = ledger.found
    assert absent.code == "proof.inputs_absent"
    assert "cad/bars.toml" in absent.message


def test_copies_without_a_defect_are_good(bundle):
    parts = ("tracks", "bars.glb", "bars_ar.usdz", "bars.xml", "bars.urdf", "meshes", "unity")
    assert codes(bundle(lambda folder: None, *parts)) == set()


MALFORMED = {
    "severity of a finding": ("findings", {"severity": ["info"]}, "a known severity"),
    "code of a finding": ("findings", {"code": ["export.left_out"]}, "lacks its code"),
    "name of a check": ("checks", {"check": ["mass"]}, "has no 'check'"),
    "file of a check": ("checks", {"file": {"bars.glb": 1}}, "has no 'file'"),
    "counterpart of a check": ("checks", {"against": ["the mechanism"], "tool": "twin"}, "has no text 'against'"),
    "number of digits": ("clips", {"keys": 10**400}, "has no number 'keys'"),
    "name with a zero byte": ("inputs", {"file": "a\0b"}, ""),
    "half a character": ("inputs", {"file": "\ud800"}, ""),
    "long name": ("inputs", {"file": "a" * 5000}, ""),
    "listed with a zero byte": ("files", {"file": "a\0b"}, "is the name of no file"),
    "listed with a long name": ("files", {"file": "a" * 5000}, "is the name of no file"),
}


@pytest.mark.parametrize("name", MALFORMED)
def test_a_malformed_entry_hides_no_later_fault(name, proven):
    """What is of another type is named, and the statements after it are checked."""
    folder, contents, checks = proven
    base.write_proof(folder)
    file = folder / "proof.json"
    proof = json.loads(file.read_text().replace(base.OTHER_VERSION, __version__))
    proof["checks"] += [check.as_dict() for check in checks if check.file != "proof.json"]
    proof["findings"] = [_finding()]
    proof["verdict"] = "disagree"
    key, change, said = MALFORMED[name]
    proof[key][0].update(change)
    file.write_text(json.dumps(proof))
    ledger = Ledger("proof.json")
    check_proof_clips(proof, contents, ledger)
    check_statements(check_proof(file, ledger), folder, contents, checks, ledger)
    messages = [finding.message for finding in ledger.found]
    assert any(said in message for message in messages), messages
    assert any("by its findings it is 'agree'" in message for message in messages), messages


def test_a_warning_on_a_file_excuses_no_other_file(proven):
    folder, contents, checks = proven
    base.write_proof(folder)
    file = folder / "proof.json"
    proof = json.loads(file.read_text())
    row = next(check.as_dict() for check in checks if check.file == "bars.glb")
    proof["checks"].append({**row, "verdict": "disagree"})
    told = {}
    for place in ("bars.glb2: link 'crank'", "bars.glb: link 'crank'", "bars.glb"):
        proof["findings"] = [_finding(severity="warning", code="physics.finish", where=place)]
        file.write_text(json.dumps(proof))
        ledger = Ledger("proof.json")
        check_statements(check_proof(file, ledger), folder, contents, checks, ledger)
        told[place] = any("none of its findings does" in finding.message for finding in ledger.found)
    assert told == {"bars.glb2: link 'crank'": True, "bars.glb: link 'crank'": False, "bars.glb": False}
