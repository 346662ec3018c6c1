"""Validate messages from a page before they are passed to viser, which does not validate messages.

A valid message has one of a few types, its fields have the types that viser declares, its numbers are finite, and its
value is possible for the page element. Files are accepted one at a time, up to a maximum size, if the parts of a file
arrive in order. Invalid messages are dropped.
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
"""Maximum size in bytes of a message that contains neither a part of a file nor a picture."""

LONGEST = 8 * 2**20
"""Maximum size in bytes of any message; the largest messages are pictures that the server has requested."""

UPLOAD = 16 * 2**20
"""Maximum size in bytes of an uploaded file (a recorded session)."""

UPLOAD_SECONDS = 120.0
"""Time in s after which a new upload cancels an unfinished upload."""

_TEXT = 200
"""Maximum number of characters in a text field."""

_FAR = 1e9
"""Maximum absolute value of the numbers in a message."""

_QUIET = 2.0
"""Minimum time in s between two notices about files."""

_PIXELS = 8_000_000
"""Maximum number of pixels of a picture, according to its header."""

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
    """The message is invalid: no page of viser sends it."""


class StaleError(Exception):
    """The message refers to a page element that was removed or changed."""


class Sender(Protocol):
    """Interface of the client that sent a message; only the client that started an upload can continue this upload."""

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
    """Return a decoder that accepts only these message types, with exactly the fields that viser declares."""
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
    """Filter of the messages that a server receives from its pages.

    Attributes:
        notify: function that shows a notice to the users.
        read: number of accepted messages.
        dropped: number of dropped messages.
    """

    def __init__(self) -> None:
        self.notify: Callable[[str], object] = lambda text: None
        self.read = self.dropped = 0
        self._gui: viser.GuiApi | None = None
        self._upload: _Upload | None = None
        self._last = -math.inf
        self._decoders = {False: _decoder(_ORDINARY), True: _decoder(_LONG)}

    def belong_to(self, server: viser.ViserServer) -> None:
        """Set the server; messages may only refer to its page elements. Before this call, all messages are dropped.

        Raises:
            TwinError: this version of viser stores the page elements in an unsupported way.
        """
        if not isinstance(getattr(server.gui, "_gui_input_handle_from_uuid", None), dict):
            raise TwinError(f"viser {viser.__version__} stores its elements in another way: install viser 1.1")
        self._gui = server.gui

    def forget(self, sender: Sender) -> None:
        """Cancel the upload of a disconnected client."""
        if self._upload is not None and self._upload.sender is sender:
            self._upload = None

    def check(self, raw: str | bytes, sender: Sender, now: float) -> None:
        """Check that a message may be passed to viser; `now` is a time in s.

        Raises:
            NonsenseError: the message is invalid.
            StaleError: the message refers to an element that was removed or changed.
        """
        try:
            self._check(raw, sender, now)
        except (NonsenseError, StaleError):
            self.dropped += 1
            raise
        self.read += 1

    def _check(self, raw: str | bytes, sender: Sender, now: float) -> None:
        if not isinstance(raw, bytes):
            raise NonsenseError("a text message; the page sends binary messages")
        try:
            message = self._decoders[len(raw) > ORDINARY].decode(raw)
        except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError):
            if len(raw) > ORDINARY:
                raise NonsenseError(f"unknown message of {len(raw)} bytes") from None
            try:  # a small message may also be the last part of a file, or a picture
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
            raise StaleError("the element was removed, or is disabled")
        return handle

    def _element(self, message: Any) -> None:
        if list(message.updates) != ["value"]:
            raise NonsenseError(f"a message may update only 'value', not {list(message.updates)[:3]}")
        handle, value = self._handle(message.uuid), message.updates["value"]
        if isinstance(handle, viser.GuiUploadButtonHandle):
            raise NonsenseError("a message must not set the value of an upload button")
        if not _suits(handle, value):
            raise NonsenseError("the value has the wrong type for its element")

    # -- files ----------------------------------------------------------------------------------------

    def _begin(self, message: Any, sender: Sender, now: float) -> None:
        if not isinstance(self._handle(message.source_component_uuid), viser.GuiUploadButtonHandle):
            raise NonsenseError("the element accepts no upload")
        if message.size_bytes > UPLOAD:
            self._tell(
                f"the file has {message.size_bytes / 1e6:.0f} MB; at most {UPLOAD / 1e6:.1f} MB are accepted", now
            )
            raise StaleError("the file is too large")
        if message.size_bytes < 1 or message.part_count < 1:
            raise NonsenseError("the file is empty")
        if self._upload is not None and now - self._upload.since < UPLOAD_SECONDS:
            self._tell("another file is being loaded: wait until it is done", now)
            raise StaleError("another upload is in progress")
        if self._upload is not None:
            self._upload.sender.cut()
        self._upload = _Upload(
            sender, message.transfer_uuid, message.source_component_uuid, message.size_bytes, message.part_count, now
        )

    def _tell(self, text: str, now: float) -> None:
        """Show the users a notice, at most one per `_QUIET` seconds."""
        if now - self._last > _QUIET:
            self._last = now
            self.notify(text)

    def _part(self, message: Any, sender: Sender) -> None:
        up = self._upload
        if up is None or up.sender is not sender or message.transfer_uuid != up.transfer:
            raise StaleError("a part of a file arrived, but no upload was started")  # the upload was refused
        up.bytes -= len(message.content)
        up.parts -= 1
        good = message.part_index == up.next and message.source_component_uuid == up.source
        if not good or up.bytes < 0 or up.parts < 0 or (up.parts == 0) != (up.bytes == 0):
            self._upload = None
            sender.cut()  # disconnecting makes viser drop the received parts
            raise NonsenseError("a part of a file has the wrong number or size for the upload in progress")
        up.next += 1
        if up.parts == 0:
            self._upload = None


def _numbers(value: Any, name: str = "") -> None:
    """Raise `NonsenseError` if a message has a number beyond `_FAR` or a quaternion that is far from length 1."""
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
            raise NonsenseError("the orientation is invalid")
    elif isinstance(value, int | float) and not abs(value) <= _FAR:
        raise NonsenseError(f"{name} = {value}")


def _suits(handle: Any, value: Any) -> bool:
    """Return whether a value is possible for an element."""
    was = handle.value
    options = getattr(handle, "options", None)
    if options is not None:
        return value in tuple(options)
    if isinstance(was, bool):
        return isinstance(value, bool)
    if isinstance(was, int | float):
        # Values from the keyboard may be outside the range of a slider; they are clamped.
        return isinstance(value, int | float) and not isinstance(value, bool)
    if isinstance(was, str):
        return isinstance(value, str) and len(value) <= _TEXT
    if isinstance(was, tuple):
        numbers = isinstance(value, list | tuple) and all(type(v) in (int, float) for v in value)
        return numbers and len(value) == len(was)
    return False


def _picture(png: bytes) -> None:
    """Raise `NonsenseError` if a picture is not PNG or is too large."""
    width, height = int.from_bytes(png[16:20], "big"), int.from_bytes(png[20:24], "big")
    if png[:8] != b"\x89PNG\r\n\x1a\n" or not 0 < width * height <= _PIXELS:
        raise NonsenseError("the picture is not PNG, or is too large")
