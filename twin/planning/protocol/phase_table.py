"""Base class of the tables of phases in a protocol file; each phase type has one, in its file in `phases`."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, ClassVar, get_args

from pydantic import Field

from twin.planning.protocol.phase import Phase
from twin.planning.protocol.protocol_file import ProtocolFile
from twin.planning.protocol.protocol_state import ProtocolState
from twin.schema import Identifier, Table

TrocarName = Annotated[
    Identifier | None,
    Field(description="the entry of [trocars_mm] that the shaft passes through; required if there are several entries"),
]

JointKey = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*_(deg|mm)$")]
"""Key of a joint value: the name of the joint and the unit of the value."""


class PhaseTable(Table):
    """Base class of the table of a phase in the file; each phase type has a subclass with `type: Literal["..."]`."""

    name: Identifier

    rank: ClassVar[int]
    """Position of the type in lists of types."""

    in_patient: ClassVar[bool] = False
    """Whether the instrument is in the patient during the phase."""

    @abstractmethod
    def advance(self, state: ProtocolState) -> None:
        """Change the state of the protocol to that at the end of the phase.

        Raises:
            DescriptionError: the phase cannot follow the phases before it.
        """

    @abstractmethod
    def phase(self, protocol_file: ProtocolFile) -> Phase:
        """Return the phase that this table of a file describes, in SI units.

        Raises:
            DescriptionError: another file, which the table names, is wrong.
        """

    def releases_rcm(self) -> bool:
        """Return whether the RCM is released at the end of the phase: the instrument has left the patient."""
        return False

    def kind(self) -> str:
        """Return the type of the phase."""
        return type(self).kind_of()

    @classmethod
    def kind_of(cls) -> str:
        """Return the value of `type` in the file for phases of this class."""
        literal = cls.model_fields["type"].annotation
        return get_args(literal)[0]
