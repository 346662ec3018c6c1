"""Files that are broken in any way: a finding or a TwinError, never a traceback."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from made import bundle as base
from twin.core.findings import EXIT_CODES
from twin.exchange.audit import audit

FILES = (
    "bars.glb",
    "tracks/swing.json",
    "tracks/swing.csv",
    "bars.xml",
    "bars.urdf",
    "bars_ar.usdz",
    "usd/geometry.usdc",
    "usd/physics.usda",
    "proof.json",
    "unity/package.json",
)


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    return base.write_good(tmp_path_factory.mktemp("good") / "bars")


def judged(path: Path) -> str:
    """Audit a file (or the package around it); its verdict must be one of the three."""
    report = audit(path.parent if path.name == "package.json" else path)
    assert report.verdict in EXIT_CODES
    assert all(f.message.endswith(".") for f in report.findings if not f.code.startswith("usd."))
    return report.verdict


def cases(data: bytes) -> dict[str, bytes]:
    return {
        "garbage": b"\x00\xff garbage \x80" * 20,
        "text": b"hello",
        "half": data[: len(data) // 2],
        "almost whole": data[:-3],
        "one byte": data[:1],
        "header twice": data[:64] + data,
        "zeros": bytes(len(data)),
        "nested": b'{"asset":' + b"[" * 100_000,
        "numbers": b'{"asset": {"version": "2.0"}, "nodes": [1, 2], "schema": "twin-track", "links": 3}',
    }


NATIVE = ("bars.xml", "bars_ar.usdz", "usd/geometry.usdc", "usd/physics.usda")
"""Files whose parsers are tried in processes of their own, so that each case takes half a second."""


def broken():
    """Return each file with each kind of damage."""
    for name in FILES:
        for kind in cases(b""):
            again = name in NATIVE and kind in ("almost whole", "header twice", "zeros", "nested", "numbers")
            yield pytest.param(name, kind, marks=pytest.mark.nightly if again else ())


@pytest.mark.parametrize(("name", "kind"), [*broken()])
def test_a_broken_file_is_a_finding(name, kind, good, tmp_path):
    file = tmp_path / "unity" / Path(name).name
    file.parent.mkdir()
    file.write_bytes(cases((good / name).read_bytes())[kind])
    harmless = name.endswith(".csv") and kind in ("almost whole", "header twice")  # a digit less, a comment more
    assert judged(file) in ("unchecked", "disagree") or harmless


@pytest.mark.parametrize("name", [n for n in FILES if "package" not in n and "proof" not in n])
def test_an_empty_file_is_a_finding(name, tmp_path):
    file = tmp_path / Path(name).name
    file.write_bytes(b"")
    (finding,) = audit(file).findings
    assert finding.code == "file.empty"


@pytest.mark.parametrize("at", [8, 12, 16])
def test_lengths_in_a_header_are_not_believed(at, good, tmp_path):
    data = bytearray((good / "bars.glb").read_bytes())
    struct.pack_into("<I", data, at, 0xFFFFFFF0)
    (tmp_path / "x.glb").write_bytes(data)
    assert judged(tmp_path / "x.glb") == "unchecked"


@pytest.mark.parametrize("section", [b"TOKENS", b"FIELDS", b"FIELDSETS", b"PATHS", b"SPECS"])
def test_counts_in_a_binary_layer_are_not_believed(section, good, tmp_path):
    """OpenUSD would ask for the memory first, and take minutes to give up."""
    data = bytearray((good / "usd/geometry.usdc").read_bytes())
    (table,) = struct.unpack_from("<q", data, 16)
    entry = data.index(section + b"\0", table)
    (start,) = struct.unpack_from("<q", data, entry + 16)
    struct.pack_into("<Q", data, start, 2**40)
    (tmp_path / "x.usdc").write_bytes(data)
    (finding,) = audit(tmp_path / "x.usdc").findings
    assert finding.code == "usd.header"
    assert section.decode() in finding.message


CHANGED = ("bars.glb", "tracks/swing.json", "bars.urdf", pytest.param("usd/physics.usda", marks=pytest.mark.slow))


@pytest.mark.parametrize("name", CHANGED)
@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_changed_bytes_raise_nothing(name, good, tmp_path, data):
    content = bytearray((good / name).read_bytes())
    places = st.integers(0, min(len(content), 6000) - 1)
    for at, byte in data.draw(st.lists(st.tuples(places, st.integers(0, 255)), min_size=1, max_size=6)):
        content[at] = byte
    file = tmp_path / Path(name).name
    file.write_bytes(content)
    judged(file)
