"""Read XML as entries."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from twin.exchange.audit.reference_export.entries import Entry, numbered
from twin.exchange.audit.xml_root import parse_xml

COMMENT = "comment"
"""Kind of the entries of comments."""

_TEXT = "text inside"
"""Key of the text of an element; no attribute has a name with a space."""


def read_xml(path: Path) -> Entry:
    """Return the elements of an XML file with their attributes and texts, and its comments.

    Raises:
        ReadError: the file is not XML, or declares entities, which could expand without limit.
    """
    parse_xml(path)
    parser = ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))
    root = ET.fromstring(path.read_bytes(), parser)
    # In MJCF, the order of joints and actuators is that of the numbers that a program sets.
    return _entry(root, path.resolve().parent, root.tag == "mujoco")


def _entry(element: ET.Element, folder: Path, is_ordered: bool) -> Entry:
    """Return an element and all inside; its text is that before, between and after what is inside."""
    entry = Entry(str(element.tag), element.get("name", ""), is_ordered=is_ordered)
    for key, value in element.attrib.items():
        if key == "filename":
            entry.values[key] = _relative(value, folder)
        elif key == "rpy":
            entry.values["rotation (x y z w)"] = _rotation(value)
        elif key != "name":
            entry.values[key] = _plain(value)
    text = element.text or ""
    for child in element:
        text += child.tail or ""
        if child.tag is ET.Comment:
            # The text is the name: programs that save again may leave out comments, but never change one.
            entry.entries.append(Entry(COMMENT, " ".join((child.text or "").split())))
        elif isinstance(child.tag, str):
            entry.entries.append(_entry(child, folder, is_ordered))
    if text.strip():
        entry.values[_TEXT] = _plain(text)
    entry.entries = numbered(entry.entries)
    return entry


def _relative(name: str, folder: Path) -> str:
    """Return the name of a file in a folder as relative to the folder: some programs make all names absolute."""
    file = Path(name.removeprefix("file://"))
    if file.is_absolute() and file.is_relative_to(folder):
        return file.relative_to(folder).as_posix()
    return name


def _rotation(text: str) -> Any:
    """Return the quaternion of roll, pitch and yaw, which other angles can state too; the text if it is not three."""
    angles = _plain(text)
    if not isinstance(angles, np.ndarray) or angles.shape != (3,):
        return text
    quaternion = Rotation.from_euler("xyz", angles).as_quat()
    # q and -q are the same rotation
    return quaternion * np.sign(quaternion[np.argmax(np.abs(quaternion))])


def _plain(text: str) -> Any:
    """Return a text as an array if it is a list of numbers."""
    words = text.split()
    if not words:
        return ""
    numbers = []
    for word in words:
        try:
            numbers.append(float(word))
        except ValueError:
            return " ".join(words)
    return np.array(numbers)
