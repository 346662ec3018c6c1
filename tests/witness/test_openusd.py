"""OpenUSD 26.5 in an environment of its own: it plays what is exported, and its rules of ARKit find nothing in a USDZ.

Those rules left OpenUSD with 26.8. The rules of `twin audit`, which took their place here, are held against them: every
violation that is sown is seen by both.
"""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path

import pytest
from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdPhysics, UsdShade

from made import mechanisms as made
from twin.exchange.audit import audit
from twin.exchange.formats.usdz.write import package, write_usdz
from twin.usd.check import run_usd_validators

NO = float("nan")


@pytest.mark.witness("arkit")
def test_another_openusd_shows_every_link_where_it_is(case, foreign, judge, tmp_path):
    printed = foreign.read("arkit", "read_usd.py", case.job(tmp_path / "job.json", "usd", "usdz"))
    for name, found in printed.items():
        if name.startswith("usd "):
            assert found["duration"] == pytest.approx(case.motions[name.split()[-1]].duration, abs=1e-5), name
    judge(printed, case)


@pytest.mark.witness("arkit")
def test_arkit_rules_find_nothing(case, foreign, figures):
    files = [case.usdz(protocol) for protocol in case.motions]
    printed = foreign.read("arkit", "check_arkit.py", *files)
    for file in files:
        found = printed[str(file)]
        said = [*found["errors"], *found["failed"], *found["warnings"]]
        figures.add(printed["version"] + " ARKit rules", case.robot, file.name, NO, NO, f"{len(said)} findings")
        assert not said, f"{file.name}: {said}"


@pytest.mark.witness
def test_usd_validators_find_nothing(case, figures):
    version = "UsdValidation " + ".".join(map(str, Usd.GetVersion()[1:]))
    for file in [case.usd(), *map(case.usd, case.motions), *map(case.usdz, case.motions)]:
        found = run_usd_validators(file)
        figures.add(version, case.robot, file.name, NO, NO, f"{len(found)} findings")
        assert not found, f"{file.name}: {found}"


# -- our own rules beside those of 26.5 -----------------------------------------------------------------


@pytest.fixture(scope="module")
def clean(tmp_path_factory) -> Path:
    """A small USDZ without a flaw."""
    return write_usdz(made.four_bar(), None, tmp_path_factory.mktemp("usdz") / "bars.usdz")


def edited(edit):
    """Return a defect: `edit` changes the stage, which is packed again."""

    def sow(clean: Path, out: Path) -> None:
        layer = Sdf.Layer.CreateAnonymous(".usdc")
        layer.TransferContent(Sdf.Layer.FindOrOpen(f"{clean}[bars.usdc]"))
        edit(Usd.Stage.Open(layer))
        layer.Export(str(out.with_name("bars.usdc")))
        package(out.with_name("bars.usdc"), out)

    return sow


def packed(method: int = zipfile.ZIP_STORED, extra: str = "", shift: int = 0):
    """Return a defect of the archive: compressed, with a file more, or out of line."""

    def sow(clean: Path, out: Path) -> None:
        inner = out.with_name("bars.usdc")
        Sdf.Layer.FindOrOpen(f"{clean}[bars.usdc]").Export(str(inner))
        package(inner, out)
        if method != zipfile.ZIP_STORED or shift:
            with zipfile.ZipFile(out, "w", method) as archive:
                archive.writestr("x" * shift + inner.name, inner.read_bytes())
        if extra:
            with zipfile.ZipFile(out, "a") as archive:
                info = zipfile.ZipInfo(extra)
                start = archive.start_dir + 30 + len(extra) + 4
                info.extra = b"\x86\x19" + (-start % 64).to_bytes(2, "little") + bytes(-start % 64)
                archive.writestr(info, "hello")

    return sow


def _body(stage: Usd.Stage) -> Usd.Prim:
    return next(p for p in stage.Traverse() if p.IsA(UsdGeom.Mesh))


def _no_meters(stage: Usd.Stage) -> None:
    stage.GetRootLayer().pseudoRoot.ClearInfo("metersPerUnit")


def _no_binding_api(stage: Usd.Stage) -> None:
    _body(stage).RemoveAPI(UsdShade.MaterialBindingAPI)


def _strange_shader(stage: Usd.Stage) -> None:
    shader = next(UsdShade.Shader(p) for p in stage.Traverse() if p.IsA(UsdShade.Shader))
    shader.SetShaderId("NoSuchSurface")


def _dangling_material(stage: Usd.Stage) -> None:
    _body(stage).GetRelationship("material:binding").SetTargets(["/bars/materials/none"])


DEFECTS = {
    "compressed": packed(method=zipfile.ZIP_DEFLATED),
    "out of line": packed(shift=1),
    "text file inside": packed(extra="notes.txt"),
    "no default prim": edited(lambda stage: stage.ClearDefaultPrim()),
    "no metersPerUnit": edited(_no_meters),
    "no upAxis": edited(lambda stage: stage.GetRootLayer().pseudoRoot.ClearInfo("upAxis")),
    "z up": edited(lambda stage: UsdGeom.SetStageUpAxis(stage, "Z")),
    "joint": edited(lambda stage: UsdPhysics.RevoluteJoint.Define(stage, "/bars/hinge")),
    "light": edited(lambda stage: UsdLux.SphereLight.Define(stage, "/bars/lamp")),
    "missing reference": edited(lambda stage: _body(stage).GetReferences().AddReference("./none.usdc")),
    "mesh below a mesh": edited(lambda stage: UsdGeom.Mesh.Define(stage, _body(stage).GetPath().AppendChild("m"))),
    "no MaterialBindingAPI": edited(_no_binding_api),
    "dangling material": edited(_dangling_material),
    "unknown shader": edited(_strange_shader),
}


def test_audit_of_a_clean_usdz_is_silent(clean):
    assert [f for f in audit(clean).findings if f.severity != "info"] == []


@pytest.mark.witness("arkit")
def test_violations_are_seen_by_both(clean, foreign, figures, tmp_path):
    files = {}
    for name, sow in DEFECTS.items():
        folder = tmp_path / name.replace(" ", "_")
        folder.mkdir()
        sow(clean, folder / "bars.usdz")
        files[name] = folder / "bars.usdz"
    shutil.copy(clean, tmp_path / "clean.usdz")
    printed = foreign.read("arkit", "check_arkit.py", tmp_path / "clean.usdz", *files.values())
    assert not any(printed[str(tmp_path / "clean.usdz")].values())
    theirs = {n for n, f in files.items() if any(printed[str(f)].values())}
    ours = {n for n, f in files.items() if any(x.severity != "info" for x in audit(f).findings)}
    figures.add(printed["version"] + " ARKit rules", "four-bar", "sown", NO, NO, f"{len(theirs)} of {len(files)} seen")
    figures.add("twin audit", "four-bar", "sown", NO, NO, f"{len(ours)} of {len(files)} seen")
    assert theirs == set(files)
    assert ours == set(files)
