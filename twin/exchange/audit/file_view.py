"""The mechanism data of one file, as values of quantities that can be compared with those of other files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from twin.exchange.audit.colors import Rgba
from twin.exchange.audit.file_content import LinkShape
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.value_differences import Value
from twin.exchange.format import Holds
from twin.exchange.formats import family, kind_holds

MECHANISM_FORMAT = "truth"
"""`FileView.format` of the given mechanism, which is no file."""


@dataclass
class FileView:
    """The mechanism data of one file, or of the given mechanism, prepared for the comparison.

    Attributes:
        file: name of the file as reports show it.
        format: format of the file; "truth" for the given mechanism.
        ledger: receives the findings on the file; None for the given mechanism.
        mechanism: mechanism data of the file.
        shapes: {link: shape of its meshes}.
        colors: {link: {colour (linear rgba): fraction of the link's area}}.
        finishes: the same for metallic and roughness, see `Content`.
        values: {(subject, quantity): value in the file}, with keys such as ("joint 'j1'", "limits").
    """

    file: str
    format: str
    ledger: Ledger | None
    mechanism: FileMechanism
    shapes: Mapping[str, LinkShape] = field(default_factory=dict)
    colors: Mapping[str, Mapping[Rgba, float]] = field(default_factory=dict)
    finishes: Mapping[str, Mapping[Rgba, float]] = field(default_factory=dict)
    values: dict[tuple[str, str], Value] = field(default_factory=dict)

    @property
    def family(self) -> str:
        """Name of the source; formats that are written from the same data have the same source."""
        return family(self.format)

    @property
    def is_mechanism(self) -> bool:
        """Whether these are the data of the given mechanism."""
        return self.format == MECHANISM_FORMAT

    def holds(self, what: Holds) -> bool:
        """Return whether files of this format contain something."""
        return kind_holds(self.format, what)

    def state(self, subject: str, values: Mapping[str, Value | None]) -> None:
        """Store the values {quantity: value} of a subject; None means that the file does not state the value."""
        for name, value in values.items():
            if value is not None:
                self.values[subject, name] = value
