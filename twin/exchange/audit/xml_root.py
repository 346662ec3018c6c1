"""Read the root element of an XML file that is audited: URDF, MJCF."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

from twin.core.foreign.text import DoctypeError
from twin.core.foreign.text import parse_xml as read_xml
from twin.exchange.audit.ledger import ReadError


def parse_xml(path: Path, data: bytes | None = None) -> ET.Element:
    """Return the root element of an XML file or, if given, of the XML `data` that was made from it.

    Raises:
        ReadError: the text is not XML, or declares entities, which could expand without limit.
    """
    try:
        return read_xml(path, data)
    except DoctypeError as error:
        raise ReadError(f"{error}") from error
    except (ET.ParseError, LookupError, ValueError) as error:
        raise ReadError(f"the file is not XML: {error}") from error
