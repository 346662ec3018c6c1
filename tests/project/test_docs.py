"""The documentation's links lead somewhere, and its mapping to USD names what the stages hold."""

from __future__ import annotations

import fnmatch
import re
from dataclasses import replace

import numpy as np
import pytest
from pxr import Sdf

from made import mechanisms, transmissions, two_trocars
from made.pages import PAGES, ROOT
from twin.model.combined_arms import joined
from twin.model.mechanism import WORLD
from twin.reference import ReferenceModel
from twin.usd.write import write_stage


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def named_code(page):
    """Return (name, file) of every link of a page from a name in code to the file that holds it."""
    found = re.findall(r"\[`([\w.]+)`\]\(([^)#]+[.]py)\)", page.read_text(encoding="utf-8"))
    return [(name.rpartition(".")[2], page.parent / file) for name, file in found]


@pytest.mark.parametrize("page", [p for p in PAGES if named_code(p)], ids=lambda p: p.name)
def test_named_code_is_where_the_page_says(page):
    for name, file in named_code(page):
        held = re.search(rf"^\s*(?:def|class) {name}\b|^{name}\b.* = ", file.read_text(encoding="utf-8"), re.MULTILINE)
        assert held or file.stem == name, f"{page.name}: {file.name} holds no {name}"


def test_derivations_name_their_code():
    assert len(named_code(ROOT / "docs/derivations.md")) > 60


class Used:
    """What layers hold: schemas, types and kinds, attributes and relationships, metadata, and values that are words."""

    def __init__(self, files):
        self.schemas, self.properties, self.others = set(), set(), set()
        for file in files:
            layer = Sdf.Layer.FindOrOpen(str(file))
            self.others |= set(layer.pseudoRoot.ListInfoKeys())
            layer.Traverse(Sdf.Path.absoluteRootPath, lambda path, layer=layer: self._add(layer.GetObjectAtPath(path)))

    def _add(self, spec):
        if isinstance(spec, Sdf.PrimSpec):
            applied = spec.GetInfo("apiSchemas").GetAppliedItems() if spec.HasInfo("apiSchemas") else ()
            self.schemas |= {spec.typeName, *(name.partition(":")[0] for name in applied)}
            self.others |= {spec.kind, spec.name, *(f"twin:{key}" for key in spec.customData.get("twin", ()))}
        elif isinstance(spec, Sdf.PropertySpec):
            self.properties.add(spec.name)
            if isinstance(spec, Sdf.AttributeSpec) and isinstance(spec.default, str):
                self.others.add(spec.default)

    def __contains__(self, word):
        return any(fnmatch.filter(names, word) for names in (self.schemas, self.properties, self.others))


@pytest.fixture(scope="module")
def mapped():
    """The words in code of the USD column of docs/usd-mapping.md; `<robot>_sim.usda` and the like are no names."""
    words, column = set(), 0
    for line in (ROOT / "docs/usd-mapping.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        column = cells.index("USD") if "USD" in cells else column if line.startswith("|") else 0
        words |= set(re.findall(r"`([^`]+)`", cells[column])) if column else set()
    return {word for word in words if "<" not in word}


@pytest.fixture(scope="module")
def used():
    """What the committed stages hold."""
    return Used(sorted((ROOT / "usd").rglob("*.usd[ac]")))


def test_stages_hold_what_the_mapping_names(mapped, used, tmp_path):
    slider = mechanisms.slider()  # no committed robot has a cylindrical joint
    base = slider.bodies[0]
    clear = tuple(
        replace(mesh, color_rgba=(0.5, 0.5, 0.5, 0.5)) for mesh in base.meshes
    )  # ... nor glass, nor part of a body
    slider = replace(slider, bodies=(replace(base, meshes=clear, whole=False), *slider.bodies[1:]))
    write_stage(slider, tmp_path, *mechanisms.slider_state(0.0, 0.0))
    hands = two_trocars.mechanism()  # ... nor several trocars
    write_stage(hands, tmp_path / "hands", hands.rest, {j.name: 0.0 for j in hands.joints})
    arm = transmissions.raven()  # ... nor motors apart from its joints
    model = ReferenceModel(arm)
    write_stage(arm, tmp_path / "motors", model.home().link_poses, model.home().q_full)
    afloat = joined({"slider": (slider, np.eye(4))})  # ... nor a floating base, nor the gravity of the moon
    joints = tuple(replace(j, type="free") if j.parent == WORLD else j for j in afloat.joints)
    afloat = replace(afloat, name="afloat", joints=joints, gravity=(0.0, 0.0, -1.62))
    model = ReferenceModel(afloat)
    write_stage(afloat, tmp_path / "afloat", model.home().link_poses, model.home().q_full)
    more = Used(tmp_path.rglob("*.usd[ac]"))
    assert len(mapped) > 100
    assert {word for word in mapped if word not in used and word not in more} == set()


def test_mapping_names_what_the_stages_hold(mapped, used):
    spoken = ("physics:", "drive:", "state:", "physx", "newton:", "mjc:", "twin:", "inputs:", "primvars:")
    held = {name for name in used.properties if name.startswith(spoken)} - {"primvars:normals:indices"}
    held |= used.schemas - {""} | {name for name in used.others if name.startswith("twin:")}
    assert {name for name in held if not any(fnmatch.fnmatch(name, word) for word in mapped)} == set()
