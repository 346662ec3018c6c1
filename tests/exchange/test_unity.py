"""The Unity package as files; what its C# does is shown by mono, tests/witness/test_mono.py."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import twin
from twin.core.errors import OutputError
from twin.core.spatial import matrix_from_quat_wxyz
from twin.exchange.formats.unity import write as unity
from twin.exchange.formats.unity.write import PACKAGE, package_files, write_unity
from twin.schema.track import Track
from unity import make_golden
from unity import make_metas as metas

ROOT = Path(__file__).parents[2]


MANIFEST = json.loads((PACKAGE / "package.json").read_text(encoding="utf-8"))
CODE = sorted(PACKAGE.rglob("*.cs"))


def test_manifest_is_complete():
    assert MANIFEST["name"] == metas.NAME == "com.twin.player"
    assert MANIFEST["version"] == twin.__version__
    assert MANIFEST["unity"] == "2022.3"
    assert f"## [{MANIFEST['version']}]" in (PACKAGE / "CHANGELOG.md").read_text(encoding="utf-8")
    assert (PACKAGE / "LICENSE.md").read_text(encoding="utf-8") == (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert all(n.startswith("com.unity.modules.") for n in MANIFEST["dependencies"]), "parts of the engine only"
    for sample in MANIFEST["samples"]:
        assert any((PACKAGE / sample["path"]).glob("*.cs"))


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.asmdef")), ids=lambda p: p.name)
def test_assembly_definition(path):
    found = json.loads(path.read_text(encoding="utf-8"))
    assert found["name"] == path.stem
    editor_only = "Editor" in path.relative_to(PACKAGE).parts
    assert found["includePlatforms"] == (["Editor"] if editor_only else [])
    assert ("UNITY_INCLUDE_TESTS" in found["defineConstraints"]) == ("Tests" in path.parts)
    assert ("nunit.framework.dll" in found["precompiledReferences"]) == ("Tests" in path.parts)
    own = {p.stem for p in PACKAGE.rglob("*.asmdef")}
    assert {r for r in found["references"] if r.startswith("Twin.")} <= own


def test_metas_are_current():
    """`python tests/unity/make_metas.py` writes them."""
    assert metas.there() == metas.wanted()


def test_every_file_that_unity_sees_has_a_guid_of_its_own():
    shown = [p for p in PACKAGE.rglob("*") if p.suffix != ".meta" and not metas.is_hidden(p.relative_to(PACKAGE))]
    found = [re.search(r"^guid: ([0-9a-f]{32})$", Path(f"{p}.meta").read_text(), re.M)[1] for p in shown]
    assert len(set(found)) == len(found) > 30
    assert not [p for p in PACKAGE.rglob("*.meta") if metas.is_hidden(p.relative_to(PACKAGE))]


def test_guids_do_not_change():
    """A project refers to scripts by these: another value breaks every scene that uses them."""
    assert metas.guid(Path("Runtime/TrackPlayer.cs")) == "139bf194873f6a4dcf3498445aa9a5e8"
    assert metas.guid(Path("Runtime/Twin.Player.asmdef")) == "066f6d0875cd5adc6f89d929f994ffc5"


@pytest.mark.parametrize("change", ["lost", "stale", "left over"])
def test_a_meta_that_is_wrong_is_seen(tmp_path, change):
    (tmp_path / "A.cs").write_text("")
    (tmp_path / "Samples~").mkdir()
    (tmp_path / "Samples~/B.cs").write_text("")
    for path, text in metas.wanted(tmp_path).items():
        (tmp_path / path).write_text(text)
    assert metas.there(tmp_path) == metas.wanted(tmp_path)
    assert list(metas.wanted(tmp_path)) == [Path("A.cs.meta")]
    if change == "lost":
        (tmp_path / "A.cs.meta").unlink()
    elif change == "stale":
        (tmp_path / "A.cs").rename(tmp_path / "C.cs")
        (tmp_path / "A.cs.meta").rename(tmp_path / "C.cs.meta")
    else:
        (tmp_path / "B.cs.meta").write_text("")
    assert metas.there(tmp_path) != metas.wanted(tmp_path)


def _fields(code: str, name: str) -> dict[str, str]:
    """Return the public fields of a C# class with their types."""
    body = code.split(f"class {name}\n")[1].split("\n    }\n")[0]
    return {m[2]: m[1] for m in re.finditer(r"^ {8}public ([\w\[\]]+) (\w+)(?: = .*)?;$", body, re.M)}


def test_the_track_has_the_fields_of_the_schema():
    fields = _fields((PACKAGE / "Runtime/Track.cs").read_text(encoding="utf-8"), "Track")
    schema = Track.model_json_schema(by_alias=True)
    assert list(fields) == list(schema["properties"])
    for name, entry in schema["properties"].items():
        kind, of = _kind(entry), _kind(entry.get("items", {}))
        wanted = {"array": {"number": ("double[]", "float[]"), "integer": ("int[]",), "string": ("string[]",)}.get(of)}
        allowed = wanted.get(kind) or {"string": ("string",), "integer": ("int",), "number": ("double",)}[kind]
        assert fields[name] in allowed, name


def _kind(entry: dict) -> str:
    if "const" in entry or "enum" in entry:
        value = entry.get("const", entry.get("enum", [None])[0])
        return "integer" if isinstance(value, int) else "string"
    return entry.get("type", "")


def test_golden_vectors_have_the_fields_that_are_read():
    fields = _fields((PACKAGE / "Runtime/Golden.cs").read_text(encoding="utf-8"), "Golden")
    golden = json.loads(make_golden.FILE.read_text(encoding="utf-8"))
    assert set(fields) == set(golden)
    assert make_golden.FILE.stat().st_size < 60_000


def test_golden_poses_are_those_of_the_robot(sils_model):
    """The quick half of `make_golden.py --check`: the mechanism solved again at the joints that the file gives."""
    track = json.loads(make_golden.FILE.read_text(encoding="utf-8"))["track"]
    Track.model_validate(track)
    q = np.reshape(track["positions"], (track["frames"], -1))
    q = q[:, [track["joints"].index(j.name) for j in sils_model.mechanism.active]]
    links = sils_model.link_poses(sils_model.run(q).x)
    poses = np.reshape(track["poses"], (track["frames"], -1, 7))
    for i, name in enumerate(track["links"]):
        assert np.abs(poses[:, i, :3] - links[name][:, :3, 3]).max() < 2e-6, name
        R = matrix_from_quat_wxyz(np.roll(poses[:, i, 3:], 1, axis=-1))
        assert np.abs(R - links[name][:, :3, :3]).max() < 1e-5, name


@pytest.mark.slow
def test_golden_vectors_are_current():
    """`python tests/unity/make_golden.py` writes them."""
    now = json.loads(make_golden.text(make_golden.golden()))
    assert make_golden.differences(json.loads(make_golden.FILE.read_text(encoding="utf-8")), now) == []


def test_a_golden_file_that_is_not_current_is_seen():
    then = {"a": [1.0, 2.0], "b": "x"}
    assert make_golden.differences(then, {"a": [1.0, 2.0 + 1e-7], "b": "x"}) == []
    assert make_golden.differences(then, {"a": [1.0, 2.1], "b": "x"}) == [".a[1]: 2.0 is now 2.1"]
    assert make_golden.differences(then, {"a": [1.0], "b": "x"})
    assert make_golden.differences(then, {"a": [1.0, 2.0]})


def test_code_uses_nothing_but_the_engine():
    for path in CODE:
        used = set(re.findall(r"^using (?:static )?([\w.]+);", path.read_text(encoding="utf-8"), re.M))
        allowed = {"UnityEngine", "UnityEngine.Events", "UnityEngine.Scripting", "Twin.Player"}
        allowed |= {"UnityEditor"} if "Editor" in path.parts else set()
        allowed |= {"NUnit.Framework"} if "Tests" in path.parts else set()
        if "Headset" in path.parts:  # the sample that needs these toolkits
            allowed |= {"MixedReality.Toolkit", "MixedReality.Toolkit.SpatialManipulation", "MixedReality.Toolkit.UX"}
            allowed |= {"UnityEngine.XR.Interaction.Toolkit"}
            allowed |= (
                {"UnityEditor.SceneManagement", "UnityEngine.SceneManagement"} if "Editor" in path.parts else set()
            )
        assert {u for u in used if not u.startswith("System")} <= allowed, path.name


def test_code_is_whole():
    """What a slip of an editor leaves behind; mono's compiler says the rest."""
    assert len(CODE) > 20
    for path in CODE:
        text = path.read_text(encoding="utf-8")
        assert len(text.splitlines()) <= 400, path.name
        bare = re.sub(r'//[^\n]*|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\])\'', "", text)
        counts = Counter(bare)
        assert counts["{"] == counts["}"], path.name
        assert counts["("] == counts[")"], path.name
        assert "\t" not in text
        assert text.endswith("}\n") or path.name == "AssemblyInfo.cs", path.name
        # A scene finds a component by the name of its file.
        assert set(re.findall(r"class (\w+) : MonoBehaviour", text)) <= {path.stem}


def test_the_package_is_copied_as_it_is(tmp_path):
    first, second = write_unity(tmp_path / "a"), write_unity(tmp_path / "b")
    assert [p.relative_to(tmp_path / "a").as_posix() for p in first] == list(package_files())
    for a, b in zip(first, second, strict=True):
        assert a.read_bytes() == b.read_bytes() == (PACKAGE / a.relative_to(tmp_path / "a")).read_bytes()
    assert (tmp_path / "a/Samples~/Player/PlayerDemo.cs").is_file()
    assert (tmp_path / "a/Documentation~/index.md").is_file()


def test_a_package_that_is_missing_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(unity, "PACKAGE", tmp_path)
    with pytest.raises(OutputError, match="the Unity package is not in"):
        write_unity(tmp_path / "out")


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write to"):
        write_unity(tmp_path / "file")
