"""What an exported file declares is compared field by field: control maps, loops, transmissions, scripts."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from made.bundle import grave, write_good
from twin.exchange.audit import audit
from twin.exchange.audit.report import Ledger
from twin.exchange.audit.unity import check_package
from twin.exchange.audit.unity_shipped import PACKAGE


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    return write_good(tmp_path_factory.mktemp("good") / "bars")


def edited(good: Path, folder: Path, name: str, pattern: str, new) -> Path:
    """Return the path of a copy of a file of the bundle in which the first match of a pattern is replaced."""
    shutil.copytree(good / "meshes", folder / "meshes")
    text, count = re.subn(pattern, new, (good / name).read_text(), count=1)
    assert count == 1
    (folder / name).write_text(text)
    return folder / name


def ranged(text: str) -> str:
    """Return a range with its sign changed, made asymmetric: the negative of a symmetric range is the range itself."""
    low, high = map(float, text.split())
    return f"{-high - 0.3} {-low + 0.3}"


CONTROLS = (
    (r'gainprm="([^"]+)"', lambda m: f'gainprm="{float(m[1].split()[0]) / 57.3}"', "mjcf.control"),
    (r'gainprm="([^"]+)"', lambda m: f'gainprm="{float(m[1].split()[0]) * 57.3}"', "mjcf.control"),
    (r'ctrlrange="([^"]+)"', lambda m: f'ctrlrange="{ranged(m[1])}"', "mjcf.control"),
    (r'(<connect [^>]*)solref="[^"]+"', lambda m: f'{m[1]}solref="0.02 1"', "mjcf.softness"),
    (r'(<connect [^>]*)solimp="[^"]+"', lambda m: f'{m[1]}solimp="0.9 0.95 0.001 0.5 2"', "mjcf.softness"),
)


@pytest.mark.parametrize(("pattern", "new", "code"), CONTROLS)
def test_a_wrong_control_map_or_a_soft_loop_of_an_mjcf_is_found(pattern, new, code, good, tmp_path):
    if not re.search(pattern, (good / "bars.xml").read_text()):
        pytest.fail(f"the MJCF of the bundle has no {pattern}")
    file = edited(good, tmp_path, "bars.xml", pattern, new)
    assert code in {f.code for f in grave(audit(file).findings)}


TRANSMISSION = """<transmission name="{0}"><type>transmission_interface/SimpleTransmission</type>
<joint name="{1}"/><actuator name="{2}"><mechanicalReduction>1</mechanicalReduction></actuator>
</transmission></robot>"""


def test_a_swapped_transmission_of_a_urdf_is_found(good, tmp_path):
    text = re.sub("<transmission.*?</transmission>", "", (good / "bars.urdf").read_text(), flags=re.DOTALL)
    names = re.findall(r'<joint name="([^"]+)" type="revolute"', text)
    found = {}
    for case, joint in (("right", names[0]), ("wrong", names[1])):
        folder = tmp_path / case
        shutil.copytree(good / "meshes", folder / "meshes")
        file = folder / "bars.urdf"
        file.write_text(text.replace("</robot>", TRANSMISSION.format("drive", joint, names[0])))
        found[case] = {f.code for f in grave(audit(file).findings)}
    assert found == {"right": set(), "wrong": {"urdf.transmission"}}


def faults(folder: Path) -> list[str]:
    ledger = Ledger("unity")
    check_package(folder, ledger)
    return [f.where for f in ledger.findings if f.code == "unity.shipped"]


def test_scripts_of_the_unity_package_are_those_that_twin_ships(tmp_path):
    folder = tmp_path / "unity"
    shutil.copytree(PACKAGE, folder)
    assert not faults(folder)
    scripts = sorted(folder.rglob("*.cs"))
    for script in scripts[::7]:
        text = script.read_bytes()
        brace = text.rindex(b"}")
        script.write_bytes(text[:brace] + text[brace + 1 :])
        assert faults(folder) == [f"unity: {script.relative_to(folder).as_posix()}"]
        script.write_bytes(text.replace(b"\n", b"\r\n"))
        assert not faults(folder)
