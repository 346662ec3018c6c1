"""Write README.txt of an export: files, units, assumptions, and untested uses."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

from twin.core.findings import Finding
from twin.core.units import DEG, UM
from twin.core.version import __version__
from twin.exchange.formats import format_named, formats_with_use
from twin.exchange.write.order import Order

_WIDTH = 100

_CONVENTIONS = (
    "- Metres, kilograms, seconds, radians. UsdPhysics angles are degrees, as the format requires.",
    "- The robot's own world is z up, right-handed; it is the frame of the base. Link poses in every file and in the "
    "stream of `twin serve` are poses in that world.",
    "- GLB and USDZ are y up: their root node rotates the robot by -90 degrees about x. Links below the root keep "
    "their z-up poses, so that a pose of the tracks can be assigned to a node unchanged.",
    "- Quaternions are x y z w (USD: w x y z); their signs do not change from key to key.",
    "- Unity is left-handed. A glTF importer mirrors x: (x, y, z) becomes (-x, y, z), the quaternion (x, -y, -z, w). "
    "ROS importers use (-y, z, x) and (-y, z, x, -w). The player of the Unity package supports both conventions.",
    "- Names of links, joints and frames are the same in every file.",
)
"""Lines on units, frames and orders of numbers."""

_UNTESTED = (
    "- These files have not been shown on a physical headset, an iPhone or a graphics card.",
    "- The Unity editor has not run the Unity package: its C# was compiled and tested against a stub of UnityEngine. "
    "The package has a self-test to be run in the editor.",
)
"""Lines on what has not been tested."""


def text(order: Order, formats: Sequence[str], findings: Sequence[Finding]) -> str:
    """Return the text of README.txt for the given formats; `findings` come from the robot and the writers."""
    head = f"{order.mechanism.name}: {order.title}"
    lines = [head, "=" * len(head), "", f"Written by twin {__version__} from: {order.source}", ""]
    uses = []
    for format in formats_with_use():
        if format.name in formats:
            uses.append(format.use)
    messages = []
    for finding in findings:
        messages.append(f"- {finding.message}")
    for title, body in (
        ("What is where", list(_files(order, formats))),
        ("Conventions", _CONVENTIONS),
        ("Motions", list(_motions(order))),
        ("How to use it", uses),
        ("Findings of the export", messages or ["- nothing"]),
        ("What has not been tested", _UNTESTED),
        ("Assumed: numbers that are not published", list(_assumed(order))),
    ):
        lines += [title, "-" * len(title), *_wrapped(body), ""]
    return "\n".join(lines)


def _files(order: Order, formats: Sequence[str]) -> Iterator[str]:
    file_rows = []
    for name in formats:
        file_rows += format_named(name).module("write").files(order)
    file_rows.append(("proof.json", "source and hash of every file, and the values measured by independent readers"))
    width = 0
    for file, _ in file_rows:
        width = max(width, len(file))
    for file, content in file_rows:
        yield f"{file.ljust(width)}  {content}"


def _motions(order: Order) -> Iterator[str]:
    if not order.clips:
        yield "- none"
    for clip in order.clips:
        budget = clip.budget
        # Linear interpolation errs with the square of the time between keys: twice the time, four times the error.
        measured = "measured with every second sample left out; with all samples the error is about a quarter of this"
        if budget is not None:
            measured = (
                f"budget: {budget.position / UM:g} um, {budget.rotation / DEG:g} degrees, {budget.joint_gap / UM:g} um"
            )
        position = clip.between.position / UM
        rotation = clip.between.rotation / DEG
        gap = clip.between.joint_gap / UM
        yield (
            f"- {clip.name}: {clip.title}; {clip.times[-1]:.3f} s, {len(clip.times)} keys at {clip.rate:g} Hz. A "
            f"player that interpolates linearly between keys is at most {position:.1f} um off at any point of a link "
            f"and {rotation:.4f} degrees; joints open by at most {gap:.1f} um ({measured})."
        )


def _assumed(order: Order) -> Iterator[str]:
    of_protocols: dict[str, list[str]] = {}
    for clip in order.clips:
        for line in clip.assumed:
            of_protocols.setdefault(line, []).append(clip.name)
    if not order.assumed and not of_protocols:
        yield "- none"
    for line in order.assumed:
        yield f"- {line}"
    for line, protocols in of_protocols.items():
        yield f"- {', '.join(protocols)}: {line}"


def _wrapped(lines: Sequence[str]) -> Iterator[str]:
    for line in lines:
        if "  " in line:  # a row of a table
            yield line
            continue
        indent = ""
        if line.startswith("- "):
            indent = "  "
        # For an empty line, `wrap` returns nothing; long words are paths and names, which must stay whole to be
        # copied.
        yield from textwrap.wrap(line, _WIDTH, subsequent_indent=indent, break_long_words=False) or [""]
