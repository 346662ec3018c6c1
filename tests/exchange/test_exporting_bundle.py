"""`twin export` and `twin.export`: the folder, its proof, what is refused, what is left alone."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

import twin
import twin.exchange.audit
from made import own_robot
from twin import api
from twin.cli import main
from twin.core.errors import TwinError
from twin.core.findings import Finding
from twin.exchange.audit.ledger import Check
from twin.exchange.format import Format, Places
from twin.exchange.formats import export_formats
from twin.exchange.write import bundle as bundles
from twin.exchange.write.clip import ClipAccuracy

ROOT = Path(__file__).parents[2]
SHORT = ROOT / "tests/data/short.toml"
FORMATS = tuple(format.name for format in export_formats() if format.variants)


@pytest.fixture(scope="module")
def robot():
    return api.load("sils")


@pytest.fixture(scope="module")
def made(robot, tmp_path_factory):
    folder = tmp_path_factory.mktemp("bundle") / "sils"
    return api.export(robot, out=folder, to=FORMATS, protocols=[SHORT])


@pytest.fixture(scope="module")
def proof(made):
    return json.loads((made.folder / "proof.json").read_text(encoding="utf-8"))


@dataclass
class Judged:
    """What a stand-in for the audit hands back: it has looked at every file."""

    folder: Path
    findings: tuple = ()

    checks: list[Check] = field(init=False)

    def __post_init__(self):
        files = [p.relative_to(self.folder).as_posix() for p in self.folder.rglob("*") if p.is_file()]
        self.checks = [Check("looked at", f, "stand-in", "1", None, "", None, "agree") for f in files]


@pytest.fixture
def no_audit(monkeypatch):
    """Skip the audit: the test is of something else."""
    monkeypatch.setattr(twin.exchange.audit, "audit", lambda folder, **_: Judged(folder))


def tree(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


# ---------------------------------------------------------------------------------------------- what is written


def test_every_file_that_was_promised_is_there(made):
    names = set(tree(made.folder))
    assert {
        "README.txt",
        "proof.json",
        "usd/sils.usda",
        "usd/physics.usda",
        "usd/geometry.usdc",
        "usd/motion/short.usdc",
        "usd/sils_short.usda",
        "usd/sils_sim.usda",
        "sils_ar.usdz",
        "sils.glb",
        "tracks/short.json",
        "tracks/short.csv",
        "tracks/track.schema.json",
        "sils.xml",
        "sils.urdf",
        "sils.yaml",
    } == {n for n in names if not n.startswith("meshes/")}
    assert {p.as_posix() for p in made.files} == names


@pytest.mark.slow
def test_a_format_that_nothing_reads_again_does_not_pass(tmp_path, monkeypatch):
    write = bundles.write_format

    def chosen(name, order, folder):
        if name != "csvlinks":
            return write(name, order, folder)
        (folder / "links.csv").write_text("\n".join(b.name for b in order.mechanism.bodies))
        return []

    unread = Format("csvlinks", "CSV of links", Places(export=999))
    monkeypatch.setattr(bundles, "export_formats", lambda: (*export_formats(), unread))
    monkeypatch.setattr(bundles, "write_format", chosen)
    monkeypatch.setattr(bundles.readme, "text", lambda *a: "")
    out = twin.export(twin.load("sils"), out=tmp_path / "out", to=["urdf", "csvlinks"], protocols=[])
    assert [(f.code, f.where) for f in out.findings if f.severity == "error"] == [("export.unjudged", "links.csv")]
    assert (out.verdict, out.exit_code) == ("unchecked", 2)


def test_the_command_names_every_format(capsys):
    with pytest.raises(SystemExit):
        main(["export", "--help"])
    text = " ".join(capsys.readouterr().out.split())
    assert ", ".join(format.name for format in export_formats()) in text


def test_readers_of_their_own_agree(made, proof):
    assert [f for f in made.findings if f.severity in ("disagreement", "error")] == []
    assert (made.verdict, made.exit_code, proof["verdict"]) == ("agree", 0, "agree")
    compared = [c for c in proof["checks"] if "position against" in c["check"]]
    assert {c["file"].split(".")[-1] for c in compared} >= {"json", "csv", "glb", "usda", "usdz", "xml", "urdf"}
    assert all(c["worst"] <= 1e-6 for c in compared)


@pytest.mark.slow
def test_the_same_robot_gives_the_same_bytes(made, no_audit, tmp_path):
    """Without a second audit: only proof.json, which holds its rows, is then another."""
    again = api.export(api.load("sils"), out=tmp_path / "x", to=FORMATS, protocols=[SHORT])
    first, second = tree(made.folder), tree(again.folder)
    assert first.keys() == second.keys()
    assert [n for n in first if first[n] != second[n]] == ["proof.json"]
    proofs = [json.loads(t["proof.json"]) for t in (first, second)]
    assert proofs[0]["files"] == proofs[1]["files"]
    assert proofs[0]["inputs"] == proofs[1]["inputs"]


def test_proof_lists_every_file_and_what_it_was_made_from(made, proof):
    files = {f["file"]: f for f in proof["files"]}
    there = tree(made.folder)
    assert files.keys() == there.keys() - {"proof.json"}
    for name, data in there.items():
        if name != "proof.json":
            assert files[name]["sha256"] == hashlib.sha256(data).hexdigest()
            assert files[name]["bytes"] == len(data)
    inputs = {f["file"]: f["sha256"] for f in proof["inputs"]}
    expected = {"cad/sils.toml", "cad/sils.step", "cad/dimensions.toml", "sils.py", "trajectories/short.toml"}
    assert inputs.keys() == expected
    assert inputs["cad/sils.step"] == hashlib.sha256((ROOT / "cad/sils/sils.step").read_bytes()).hexdigest()
    assert (proof["schema"], proof["version"], proof["robot"]) == ("twin-proof", 1, "sils")


def test_proof_states_the_rate_and_what_it_costs(made, proof):
    (clip,) = proof["clips"]
    assert clip["rate"] == made.order.clips[0].rate
    assert 0 < clip["between_position_m"] <= clip["budget_position_m"] == 1e-4
    rows = [c for c in proof["checks"] if c["file"] == "clip short"]
    assert [c["verdict"] for c in rows] == ["agree"] * 3
    assert {c["unit"] for c in rows} == {"m", "rad"}


def test_no_file_names_this_machine(made):
    for name, data in tree(made.folder).items():
        for word in (str(ROOT), str(made.folder), "/tmp/", ".twin-"):
            assert word.encode() not in data, name


def test_one_hash_names_the_robot_in_every_file(made, proof):
    track = json.loads((made.folder / "tracks/short.json").read_text(encoding="utf-8"))
    assert track["model_hash"] == proof["model_hash"]
    assert proof["model_hash"].encode() in (made.folder / "sils.glb").read_bytes()


def test_readme_says_what_is_assumed_left_out_and_untried(made):
    text = " ".join((made.folder / "README.txt").read_text(encoding="utf-8").split())
    assert "not been shown on a physical headset" in text
    assert "Unity editor has not run" in text
    assert "loops and couplings that the URDF cannot hold" in text
    assert "q3,q4 limits from = -10 mm: not published" in text
    assert f"keys at {made.order.clips[0].rate:g} Hz" in text
    for file in (p.as_posix() for p in made.files if p.parts[0] not in ("meshes", "tracks")):
        assert file in text or file.startswith(("usd/motion", "usd/physics", "usd/geometry", "README")), file


# ---------------------------------------------------------------------------------------------- exporting again


@pytest.mark.slow
def test_files_of_an_earlier_export_go_and_others_stay(robot, no_audit, tmp_path):
    folder = tmp_path / "out"
    api.export(robot, out=folder, to=("tracks", "urdf"), protocols=[SHORT])
    (folder / "mine.txt").write_text("keep")
    edited = folder / "sils.urdf"
    edited.write_text(edited.read_text() + "<!-- mine -->")
    made = api.export(robot, out=folder, to=("glb",), protocols=[SHORT])
    assert set(tree(folder)) == {"README.txt", "proof.json", "sils.glb", "mine.txt", "sils.urdf"}
    assert not (folder / "meshes").exists()
    assert {p.name for p in made.files} == {"README.txt", "proof.json", "sils.glb"}


def test_a_foreign_proof_removes_nothing_outside(robot, no_audit, tmp_path):
    folder, outside = tmp_path / "out", tmp_path / "precious.txt"
    outside.write_text("x")
    folder.mkdir()
    sha = hashlib.sha256(b"x").hexdigest()
    listed = {"schema": "twin-proof", "files": [{"file": "../precious.txt", "sha256": sha}]}
    (folder / "proof.json").write_text(json.dumps(listed))
    api.export(robot, out=folder, to=("glb",), protocols=[SHORT])
    assert outside.read_text() == "x"


def test_an_error_leaves_the_folder_as_it_was(robot, monkeypatch, tmp_path):
    def broken(folder, **_):
        raise TwinError("the audit cannot read")

    monkeypatch.setattr(twin.exchange.audit, "audit", broken)
    (tmp_path / "mine.txt").write_text("keep")
    with pytest.raises(TwinError, match="the audit cannot read"):
        api.export(robot, out=tmp_path, to=("glb",), protocols=[SHORT])
    assert set(tree(tmp_path)) == {"mine.txt"}


# ---------------------------------------------------------------------------------------------- verdicts


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def call(*argv: object):
        capsys.readouterr()
        code = main([str(a) for a in argv])
        out = capsys.readouterr()
        return code, out.out, out.err

    return call


def test_an_audit_that_disagrees_ends_with_1_and_says_so(monkeypatch, run):
    finding = Finding("audit.pose", "disagreement", "bar1 is 3 mm off", "sils.glb")
    monkeypatch.setattr(twin.exchange.audit, "audit", lambda folder, **_: Judged(folder, (finding,)))
    code, out, _ = run("export", "sils", "--to", "glb", "--protocol", SHORT)
    assert code == 1
    assert "FAIL: the exported files disagree" in out
    assert "bar1 is 3 mm off" in out
    proof = json.loads(Path("twin-out/sils/export/proof.json").read_text(encoding="utf-8"))
    assert proof["verdict"] == "disagree"
    assert proof["findings"][-1]["message"] == "bar1 is 3 mm off"


def test_a_defect_in_a_file_is_seen_by_the_audit(robot, monkeypatch, tmp_path):
    """The chain from writer to verdict has teeth: a millimetre in one link's keys."""
    from twin.exchange.formats.glb import write as glb

    true = glb.glb_bytes

    def shifted(mechanism, clips=(), link_poses=None):
        clip = clips[0]
        clip.links["platform"][:, 0, 3] += 1e-3
        out = true(mechanism, clips, link_poses)
        clip.links["platform"][:, 0, 3] -= 1e-3
        return out

    monkeypatch.setattr(glb, "glb_bytes", shifted)
    made = api.export(robot, out=tmp_path, to=("glb", "tracks"), protocols=[SHORT])
    assert made.verdict == "disagree"
    assert any("platform" in f.message and "glb" in f.where for f in made.findings)


def test_a_budget_that_no_rate_keeps_is_a_disagreement(no_audit, run):
    code, out, _ = run("export", "sils", "--to", "tracks", "--protocol", SHORT, "--budget-um", "0.001", "--json")
    data = json.loads(out)
    assert (code, data["verdict"]) == (1, "disagree")
    assert data["clips"][0]["rate"] == 120
    found = [f for f in data["findings"] if f["code"] == "export.budget"]
    assert found
    assert all(f["size"] > f["limit"] and "--budget-um" in f["suggestion"] for f in found)


@pytest.mark.slow
def test_a_smaller_budget_gives_more_keys(no_audit, run):
    rates = []
    for um in ("100", "3"):
        _, out, _ = run("export", "sils", "--to", "tracks", "--protocol", SHORT, "--budget-um", um, "--json")
        rates.append(json.loads(out)["clips"][0]["rate"])
    assert rates[0] < rates[1]


# ---------------------------------------------------------------------------------------------- command line


def test_text_shows_rates_sizes_and_assumptions(no_audit, run):
    code, out, _ = run("export", "sils", "--to", "glb,tracks", "--protocol", SHORT, "--out", "xr")
    assert code == 0
    for part in ("PASS", "short", "keys per second", "xr/sils.glb", "xr/tracks/", "MB in", "Assumed values"):
        assert part in out, part


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (("sils", "--to", "glb,fbx"), "there is no format 'fbx'. Known: glb, mjcf, tracks, unity, urdf, usd, usdz."),
        (("sils", "--to", "gbl"), "Did you mean 'glb'?"),
        (("sils", "--to", ","), "no format is given"),
        (("sils", "--budget-um", "0"), "--budget-um 0: give a positive number"),
        (("sils", "--budget-um", "nan"), "--budget-um nan"),
        (("sils", "--protocol", "tabel2"), "Did you mean 'table2'?"),
        (("slis",), "Did you mean 'sils'?"),
        (("no.usda",), "no.usda: the stage does not exist"),
        ((ROOT / "usd/pa10/pa10.usda", "--protocol", "circle"), "loaded from a USD stage, which has no protocols"),
    ],
)
def test_what_cannot_be_exported_is_refused_before_anything_is_written(run, argv, message, tmp_path):
    code, _, err = run("export", *argv)
    assert code == 2
    assert message in err
    assert list(tmp_path.iterdir()) == []


def test_formats_come_in_one_order_and_once():
    assert bundles.chosen_formats(None) == tuple(format.name for format in export_formats())
    assert bundles.chosen_formats(["tracks", "glb", "tracks"]) == ("glb", "tracks")


def test_a_folder_that_cannot_be_written_is_said_first(run, tmp_path):
    (tmp_path / "file").write_text("")
    code, _, err = run("export", "sils", "--to", "glb", "--out", "file")
    assert code == 2
    assert "cannot write to file" in err


# ---------------------------------------------------------------------------------------------- other robots


def test_tracks_of_a_robot_at_rest_are_refused(run):
    code, _, err = run("export", ROOT / "usd/pa10/pa10.usda", "--to", "tracks")
    assert code == 2
    assert "pa10 has no motion to export, and tracks contain only motions: choose another format as well" in err
    assert ".tmp" not in err


@pytest.mark.slow
def test_a_stage_at_rest_has_no_motion(tmp_path):
    made = api.export(api.load(ROOT / "usd/pa10/pa10.usda"), out=tmp_path, to=("glb", "tracks", "usdz"))
    assert made.order.clips == ()
    assert set(tree(tmp_path)) == {"README.txt", "proof.json", "pa10.glb", "pa10_ar.usdz", "tracks/track.schema.json"}
    assert made.verdict == "agree"


@pytest.mark.slow
def test_a_stage_with_motion_hands_its_samples_on(tmp_path):
    from twin.usd.read import read_motion

    stage = ROOT / "usd/pa10/pa10_circle.usda"
    made = api.export(api.load(stage), out=tmp_path, to=("glb", "tracks"))
    (clip,) = made.order.clips
    times, poses = read_motion(stage)
    assert (clip.name, len(clip.times)) == ("circle", len(times))
    data = json.loads((tmp_path / "tracks/circle.json").read_text(encoding="utf-8"))
    assert data["robot"] == "pa10"
    read = np.reshape(data["poses"], (len(times), -1, 7))
    for i, name in enumerate(data["links"]):
        assert np.abs(read[:, i, :3] - poses[name][:, :3, 3]).max() < 1e-6, name
    q = np.reshape(data["positions"], (len(times), -1))
    assert np.abs(np.diff(q, axis=0)).max() < 0.1, "angles do not jump by a turn"
    assert made.verdict == "agree"
    assert any(f["file"] == "pa10_circle.usda" for f in json.loads((tmp_path / "proof.json").read_text())["inputs"])


@pytest.fixture
def own(tmp_path) -> Path:
    """A robot folder of one's own, with SILS inside and one short protocol."""
    return own_robot.folder(tmp_path)


@pytest.mark.slow
def test_a_robot_folder_of_ones_own(own, no_audit, tmp_path):
    made = api.export(api.load(own), out=tmp_path / "out", to=("tracks", "glb"))
    assert [c.name for c in made.order.clips] == ["short"]
    names = [name for name, _ in made.order.inputs]
    assert names == ["cad/sils.toml", "cad/sils.step", "formula.py", "trajectories/short.toml"]


def test_a_robot_without_equations_is_exported_at_rest_and_says_why(own, no_audit, tmp_path):
    (own / "formula.py").unlink()
    made = api.export(api.load(own), out=tmp_path / "out", to=("tracks", "glb"))
    assert made.order.clips == ()
    assert any(f.code == "export.no_equations" and "short" in f.message for f in made.findings)
    with pytest.raises(TwinError, match="no equations"):
        api.export(api.load(own), out=tmp_path / "out", to=("tracks",), protocols=["short"])


def test_a_planned_trajectory_is_the_only_motion(robot, no_audit, tmp_path):
    trajectory = twin.plan(robot, SHORT)
    made = twin.export(robot, trajectory, tmp_path, ("tracks",), protocols=[SHORT], budget=ClipAccuracy(position=1e-3))
    assert [c.name for c in made.order.clips] == ["short"]
    assert made.order.clips[0].times[-1] == pytest.approx(trajectory.duration)


def test_quick_looks_are_the_default_and_those_asked_for():
    from twin.exchange.write.order_of_robot import _quick_looks

    assert _quick_looks("b", ["a", "b", "c"], are_requested=False) == ("b",)
    assert _quick_looks("b", ["a", "b", "c"], are_requested=True) == ("b", "a", "c")
    assert _quick_looks("b", ["a"], are_requested=True) == ("a",)
    assert _quick_looks("b", [], are_requested=False) == ()


@pytest.mark.parametrize(
    "alone",
    [
        "tracks",
        pytest.param("mjcf", marks=pytest.mark.slow),
        *(pytest.param(f, marks=pytest.mark.nightly) for f in ("usd", "usdz", "glb", "urdf")),
    ],
)
def test_each_format_alone_passes_its_audit(alone, robot, tmp_path):
    """Its README.txt names the motion that the file plays."""
    made = twin.export(robot, out=tmp_path / "out", to=[alone], protocols=[SHORT])
    assert [f for f in made.findings if f.severity in ("error", "disagreement")] == []
