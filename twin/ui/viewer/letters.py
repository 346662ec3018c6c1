"""What a page may say to its server: viser believes whatever comes, so every message is read here before.

A message has one of a few types, its fields have the types that viser declares, numbers are finite, and a value suits
the element of the page that it is for. Files are taken one at a time, up to a size, in order. Nothing else is passed
on.
"""

from __future__ import annotations

import math
import typing
from collections.abc import Callable
from dataclasses import MISSING, Field, dataclass, fields
from typing import Any, Protocol

import msgspec
import viser
from viser import _messages as said

from twin.core.errors import TwinError

ORDINARY = 16 * 1024
"""Bytes of a message that carries neither a file nor a picture."""

LONGEST = 8 * 2**20
"""Bytes of any message: a picture that was asked for."""

UPLOAD = 16 * 2**20
"""Bytes of a file: a recorded session as long as one may be."""

UPLOAD_SECONDS = 120.0
"""An upload that has not ended by then gives its place to the next one."""

_TEXT = 200
"""Characters of a text field."""

_FAR = 1e9
"""Numbers are smaller; a length would be that of the way to the moon."""

_QUIET = 2.0
"""Seconds between two notices about files."""

_PIXELS = 8_000_000
"""Of a picture, by its own head: it is unpacked as soon as it is there."""

_ORDINARY = (
    said.ViewerCameraMessage,
    said.GuiUpdateMessage,
    said.SceneNodeClickMessage,
    said.SceneNodeDragMessage,
    said.ScenePointerMessage,
    said.TransformControlsUpdateMessage,
    said.TransformControlsDragStartMessage,
    said.TransformControlsDragEndMessage,
    said.FileTransferStartUpload,
)
_LONG = (said.FileTransferPart, said.GetRenderResponseMessage)


class NonsenseError(Exception):
    """A message that no page of ours sends."""


class StaleError(Exception):
    """A message about what is not there any more, or not in that way."""


class Sender(Protocol):
    """Whoever sends; an upload is of the one who began it."""

    def cut(self) -> None: ...  # noqa: D102


@dataclass
class _Upload:
    sender: Sender
    transfer: str
    source: str
    bytes: int
    parts: int
    since: float
    next: int = 0


def _decoder(types: tuple[type, ...]) -> msgspec.msgpack.Decoder:
    """Return what decodes these messages and no others, with the fields that viser declares and no others."""
    structs = []
    for kind in types:
        hints = typing.get_type_hints(kind)
        structs.append(
            msgspec.defstruct(
                kind.__name__,
                [(f.name, hints[f.name], _default(f)) for f in fields(kind) if f.init],
                tag_field="type",
                tag=kind.__name__,
                forbid_unknown_fields=True,
            )
        )
    return msgspec.msgpack.Decoder(typing.Union[tuple(structs)])  # noqa: UP007


def _default(f: Field) -> Any:
    return msgspec.NODEFAULT if f.default is MISSING else f.default


class Letters:
    """Reads what comes, for one server.

    Attributes:
        told: called with a sentence for the people at the pages.
        read, dropped: messages that were passed on, and that were not.
    """

    def __init__(self) -> None:
        self.told: Callable[[str], object] = lambda text: None
        self.read = self.dropped = 0
        self._gui: viser.GuiApi | None = None
        self._upload: _Upload | None = None
        self._last = -math.inf
        self._decoders = {False: _decoder(_ORDINARY), True: _decoder(_LONG)}

    def belong_to(self, server: viser.ViserServer) -> None:
        """Know the elements of the page; before, nothing is passed on.

        Raises:
            TwinError: this version of viser keeps them elsewhere.
        """
        if not isinstance(getattr(server.gui, "_gui_input_handle_from_uuid", None), dict):
            raise TwinError(f"viser {viser.__version__} keeps its elements in another way: install viser 1.1")
        self._gui = server.gui

    def forget(self, sender: Sender) -> None:
        """Let go of the upload of somebody who has gone."""
        if self._upload is not None and self._upload.sender is sender:
            self._upload = None

    def check(self, raw: str | bytes, sender: Sender, now: float) -> None:
        """Return if a message may be passed on.

        Raises:
            NonsenseError: no page of ours sends that.
            StaleError: it would do no good.
        """
        try:
            self._check(raw, sender, now)
        except (NonsenseError, StaleError):
            self.dropped += 1
            raise
        self.read += 1

    def _check(self, raw: str | bytes, sender: Sender, now: float) -> None:
        if not isinstance(raw, bytes):
            raise NonsenseError("text")
        try:
            message = self._decoders[len(raw) > ORDINARY].decode(raw)
        except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError):
            if len(raw) > ORDINARY:
                raise NonsenseError(f"{len(raw)} bytes of something") from None
            try:  # the last part of a file may be short, and so may a picture
                message = self._decoders[True].decode(raw)
            except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
                raise NonsenseError(str(error)) from None
        if self._gui is None:
            raise StaleError("there is no page yet")
        kind = type(message).__name__
        if kind == "FileTransferPart":
            self._part(message, sender)
        elif kind == "FileTransferStartUpload":
            self._begin(message, sender, now)
        elif kind == "GetRenderResponseMessage":
            _picture(message.payload)
        else:
            _numbers(message)
            if kind == "GuiUpdateMessage":
                self._element(message)

    # -- elements -------------------------------------------------------------------------------------

    def _handle(self, uuid: str) -> Any:
        assert self._gui is not None
        handle = self._gui._gui_input_handle_from_uuid.get(uuid)
        if handle is None or getattr(handle, "disabled", False):
            raise StaleError("the element is gone, or disabled")
        return handle

    def _element(self, message: Any) -> None:
        if list(message.updates) != ["value"]:
            raise NonsenseError(f"{list(message.updates)[:3]} of an element")
        handle, value = self._handle(message.uuid), message.updates["value"]
        if isinstance(handle, viser.GuiUploadButtonHandle):
            raise NonsenseError("the value of an upload button")
        if not _suits(handle, value):
            raise NonsenseError("a value that does not suit its element")

    # -- files ----------------------------------------------------------------------------------------

    def _begin(self, message: Any, sender: Sender, now: float) -> None:
        if not isinstance(self._handle(message.source_component_uuid), viser.GuiUploadButtonHandle):
            raise NonsenseError("an upload to what takes none")
        if message.size_bytes > UPLOAD:
            self._tell(f"the file has {message.size_bytes / 1e6:.0f} MB; at most {UPLOAD / 1e6:.1f} MB are taken", now)
            raise StaleError("too large")
        if message.size_bytes < 1 or message.part_count < 1:
            raise NonsenseError("a file that is empty")
        if self._upload is not None and now - self._upload.since < UPLOAD_SECONDS:
            self._tell("another file is being loaded: wait for its end", now)
            raise StaleError("another upload")
        if self._upload is not None:
            self._upload.sender.cut()
        self._upload = _Upload(
            sender, message.transfer_uuid, message.source_component_uuid, message.size_bytes, message.part_count, now
        )

    def _tell(self, text: str, now: float) -> None:
        """Tell the people, but not as often as somebody likes."""
        if now - self._last > _QUIET:
            self._last = now
            self.told(text)

    def _part(self, message: Any, sender: Sender) -> None:
        up = self._upload
        if up is None or up.sender is not sender or message.transfer_uuid != up.transfer:
            raise StaleError("a part of no upload")  # of one that was refused
        up.bytes -= len(message.content)
        up.parts -= 1
        good = message.part_index == up.next and message.source_component_uuid == up.source
        if not good or up.bytes < 0 or up.parts < 0 or (up.parts == 0) != (up.bytes == 0):
            self._upload = None
            sender.cut()  # so that viser forgets the parts that it has
            raise NonsenseError("a part that does not fit its file")
        up.next += 1
        if up.parts == 0:
            self._upload = None


def _numbers(value: Any, name: str = "") -> None:
    """Refuse numbers that nobody can be meant by, anywhere in a message; quaternions are of unit length."""
    if isinstance(value, msgspec.Struct):
        for field in value.__struct_fields__:
            _numbers(getattr(value, field), field)
    elif isinstance(value, dict):
        for inner in value.values():
            _numbers(inner)
    elif isinstance(value, list | tuple):
        for inner in value:
            _numbers(inner)
        if name == "wxyz" and not 0.9 < math.hypot(*value) < 1.1:
            raise NonsenseError("an orientation that is none")
    elif isinstance(value, int | float) and not abs(value) <= _FAR:
        raise NonsenseError(f"{name} = {value}")


def _suits(handle: Any, value: Any) -> bool:
    """Return whether a value is one that an element can have."""
    was = handle.value
    options = getattr(handle, "options", None)
    if options is not None:
        return value in tuple(options)
    if isinstance(was, bool):
        return isinstance(value, bool)
    if isinstance(was, int | float):
        # Beyond the ends of a slider people type too: they get as far as it goes.
        return isinstance(value, int | float) and not isinstance(value, bool)
    if isinstance(was, str):
        return isinstance(value, str) and len(value) <= _TEXT
    if isinstance(was, tuple):
        numbers = isinstance(value, list | tuple) and all(type(v) in (int, float) for v in value)
        return numbers and len(value) == len(was)
    return False


def _picture(png: bytes) -> None:
    """Refuse what is no PNG, or a large one."""
    width, height = int.from_bytes(png[16:20], "big"), int.from_bytes(png[20:24], "big")
    if png[:8] != b"\x89PNG\r\n\x1a\n" or not 0 < width * height <= _PIXELS:
        raise NonsenseError("a picture that was not asked for")
