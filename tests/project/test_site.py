"""The site of the documentation: each page has a place in it, and a link that leads nowhere fails its build."""

from __future__ import annotations

import tomllib

import pytest

from made.pages import ROOT
from made.scripts import script

SETTINGS = tomllib.loads((ROOT / "docs/site/zensical.toml").read_text(encoding="utf-8"))["project"]


@pytest.fixture(scope="module")
def make_site():
    return script("docs/make_site.py")


def places(entry):
    """Return the places of all pages below an entry of the navigation."""
    if isinstance(entry, str):
        return [entry]
    if isinstance(entry, dict):
        entry = list(entry.values())
    found = []
    for part in entry:
        found += places(part)
    return found


def test_each_page_is_in_the_navigation_once(make_site):
    navigation = places(SETTINGS["nav"])
    assert len(navigation) == len(set(navigation))
    assert set(make_site.pages_of_docs().values()) <= set(navigation)


def test_links_lead_to_copies_and_pages(make_site, tmp_path):
    make_site.copy_pages(tmp_path)
    tutorial = (tmp_path / "tutorials/judge-equations.md").read_text(encoding="utf-8")
    assert "](../pictures/hexapod.png)" in tutorial
    derivations = (tmp_path / "derivations.md").read_text(encoding="utf-8")
    assert "](code/twin/core/spatial.py)" in derivations
    assert (tmp_path / "code/twin/core/spatial.py").is_file()
    assert (tmp_path / "project/CHANGELOG.md").is_file()


def test_every_public_name_is_in_the_reference(make_site, tmp_path):
    import twin

    make_site.write_python(tmp_path)
    text = (tmp_path / "reference/python.md").read_text(encoding="utf-8")
    documented = {line.rpartition(".")[2] for line in text.splitlines() if line.startswith("::: ")}
    assert documented == set(twin.__all__) - {"__version__"}


GOOD = '<a href="b.html#there"></a><img src="c.png"><a href="https://else.where/x"></a><a href="#here" id="here"></a>'


@pytest.mark.parametrize("wrong", ["b.html#nowhere", "d.html", "../c.png", "#gone"])
def test_a_link_that_leads_nowhere_is_found(make_site, tmp_path, wrong):
    (tmp_path / "a.html").write_text(GOOD, encoding="utf-8")
    (tmp_path / "b.html").write_text('<h1 id="there">b</h1>', encoding="utf-8")
    (tmp_path / "c.png").write_bytes(b"")
    assert list(make_site.broken_links(tmp_path)) == []
    (tmp_path / "a.html").write_text(GOOD + f'<a href="{wrong}"></a>', encoding="utf-8")
    assert list(make_site.broken_links(tmp_path)) == [f"a.html: {wrong}"]
