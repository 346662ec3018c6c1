"""Numbers and poses in the attributes of a URDF, with URDF's own values where an attribute is missing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from xml.etree import ElementTree as ET

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.ledger import ReadError
from twin.exchange.audit.poses import Array


def numbers(text: str | None, n: int, default: tuple[float, ...]) -> Array:
    """Return n finite numbers from the text of an attribute; the default if the text is None.

    Raises:
        ReadError: the text does not consist of n finite numbers.
    """
    if text is None:
        return np.array(default, float)
    try:
        values = np.array(text.split(), float)
    except ValueError as error:
        raise ReadError(f"'{text[:40]}' is not a list of numbers") from error
    if values.shape != (n,) or not np.all(np.isfinite(values)):
        raise ReadError(f"'{text[:40]}' is not a list of {n} finite numbers")
    return values


def attribute(element: ET.Element | None, key: str) -> str | None:
    """Return the text of an attribute; None if the element or the attribute is missing."""
    return None if element is None else element.get(key)


def number(element: ET.Element | None, key: str, default: float) -> float:
    """Return the number of an attribute; the default if the element or the attribute is missing.

    Raises:
        ReadError: the attribute is not a finite number.
    """
    return float(numbers(attribute(element, key), 1, (default,))[0])


def stated_number(element: ET.Element | None, key: str) -> float | None:
    """Return the number of an attribute; None if the element or the attribute is missing.

    Raises:
        ReadError: the attribute is not a finite number.
    """
    text = attribute(element, key)
    return None if text is None else float(numbers(text, 1, ())[0])


def origin_pose(element: ET.Element | None) -> Array:
    """Return the pose (4, 4) of an element <origin> in the frame of what it places; the identity without one."""
    if element is None:
        return np.eye(4)
    R = poses.rpy(numbers(element.get("rpy"), 3, (0, 0, 0)))
    return poses.pose(R, numbers(element.get("xyz"), 3, (0, 0, 0)))


def scale_and_pose(shape: ET.Element) -> tuple[Array, Array]:
    """Return scale (3,) and pose (4, 4) in the link of an element <visual> or <collision> with a mesh."""
    mesh = shape.find("geometry/mesh")
    return numbers(attribute(mesh, "scale"), 3, (1, 1, 1)), origin_pose(shape.find("origin"))


def repeated(names: Iterable[str]) -> list[str]:
    """Return the names that are there more than once, each once."""
    return [name for name, count in Counter(names).items() if count > 1]
