"""Parse XML into a document whose elements know the file and line where they were written, also in their copies."""

from __future__ import annotations

from xml.dom import expatbuilder, minidom

SourceLine = tuple[str, int]
"""(file, line) where an element was written."""

_SOURCE_LINE = "twin.place"
"""Key of an element's user data under which its `SourceLine` is kept."""


class LineBuilder(expatbuilder.Namespaces, expatbuilder.ExpatBuilder):
    """Builder of a document (`parseString`) whose elements have the file and line of their start tags."""

    def __init__(self, file: str) -> None:
        expatbuilder.ExpatBuilder.__init__(self)
        self._initNamespaces()  # pyright: ignore[reportAttributeAccessIssue]
        self._file = file

    def reset(self) -> None:
        """Begin a new document; both base classes must be set up again."""
        expatbuilder.ExpatBuilder.reset(self)
        self._initNamespaces()  # pyright: ignore[reportAttributeAccessIssue]

    def start_element_handler(self, name: str, attributes: list[str]) -> None:
        """Begin an element, as the base class does, and keep the line of its start tag."""
        super().start_element_handler(name, attributes)
        place = (self._file, self.getParser().CurrentLineNumber)
        self.curNode.setUserData(_SOURCE_LINE, place, _LINE_COPIER)


class _LineCopier:
    """Gives the file and line of an element to its copy: a macro's body is copied each time it is used."""

    def handle(self, operation: int, key: str, data: object, src: minidom.Node, dst: minidom.Node | None) -> None:
        """Copy the data of `src` to its copy `dst`; minidom calls this, by the names of the DOM's interface."""
        if dst is not None:
            dst.setUserData(key, data, self)


_LINE_COPIER = _LineCopier()


def source_line(node: minidom.Node | None) -> SourceLine | None:
    """Return the file and line of an element, or of the nearest element around it; None if none has them."""
    while node is not None:
        if isinstance(node, minidom.Element) and (place := node.getUserData(_SOURCE_LINE)):
            return place
        node = node.parentNode
    return None
