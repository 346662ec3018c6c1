"""Validate messages from a page before they are passed to viser, which does not validate messages.

A valid message has one of a few types, its fields have the types that viser declares, its numbers are finite, and its
value is possible for the page element. Files are accepted one at a time, up to a maximum size, if the parts of a file
arrive in order. Invalid messages are dropped.
"""

from __future__ import annotations

import math
import typing
from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields
from typing import Protocol, cast

import msgspec
import viser
from viser import _messages as viser_messages

from twin.core.errors import TwinError

MAX_ORDINARY_BYTES = 16 * 1024
"""Maximum size in bytes of a message that contains neither a part of a file nor a picture."""

MAX_MESSAGE_BYTES = 8 * 2**20
"""Maximum size in bytes of any message; the largest messages are pictures that the server has requested."""

MAX_UPLOAD_BYTES = 16 * 2**20
"""Maximum size in bytes of an uploaded file (a recorded session)."""

UPLOAD_TIMEOUT = 120.0
"""Time in s after which a new upload cancels an unfinished upload."""

_MAX_TEXT_LENGTH = 200
"""Maximum number of characters in a text field."""

_MAX_NUMBER = 1e9
"""Maximum absolute value of the numbers in a message."""

_NOTICE_PAUSE = 2.0
"""Minimum time in s between two notices about files."""

_MAX_PIXELS = 8_000_000
"""Maximum number of pixels of a picture, according to its header."""

_ORDINARY_MESSAGES = (
    viser_messages.ViewerCameraMessage,
    viser_messages.GuiUpdateMessage,
    viser_messages.SceneNodeClickMessage,
    viser_messages.SceneNodeDragMessage,
    viser_messages.ScenePointerMessage,
    viser_messages.TransformControlsUpdateMessage,
    viser_messages.TransformControlsDragStartMessage,
    viser_messages.TransformControlsDragEndMessage,
    viser_messages.FileTransferStartUpload,
)
_LONG_MESSAGES = (viser_messages.FileTransferPart, viser_messages.GetRenderResponseMessage)

_DECODING_ERRORS = (msgspec.MsgspecError, RecursionError, UnicodeDecodeError)


class NonsenseError(Exception):
    """The message is invalid: no page of viser sends it."""


class StaleError(Exception):
    """The message refers to a page element that was removed or changed."""


class _PageElement(Protocol):
    """Interface of an element of the page with a value; viser has a class for each kind of element."""

    @property
    def value(self) -> object: ...


class Sender(Protocol):
    """Interface of the client that sent a message; only the client that started an upload can continue this upload."""

    def cut(self) -> None: ...  # noqa: D102


@dataclass
class _Upload:
    """An upload in progress.

    Attributes:
        sender: the client that sends the file.
        transfer: identifier of the upload.
        source: identifier of the upload button.
        remaining_bytes, remaining_parts: number of bytes and of parts that are still to come.
        start_time: time in s at which the upload began.
        next_part: number of the next part, from 0.
    """

    sender: Sender
    transfer: str
    source: str
    remaining_bytes: int
    remaining_parts: int
    start_time: float
    next_part: int = 0


def _decoder(types: tuple[type, ...]) -> msgspec.msgpack.Decoder:
    """Return a decoder that accepts only these message types, with exactly the fields that viser declares."""
    structs = []
    for kind in types:
        struct = msgspec.defstruct(
            kind.__name__,
            _struct_fields(kind),
            tag_field="type",
            tag=kind.__name__,
            forbid_unknown_fields=True,
        )
        structs.append(struct)
    return msgspec.msgpack.Decoder(typing.Union[tuple(structs)])  # noqa: UP007


def _struct_fields(kind: type) -> list[tuple[str, type, object]]:
    """Return name, type and default of the fields that a message of viser is created with."""
    hints = typing.get_type_hints(kind)
    declared = []
    for field in fields(kind):
        if not field.init:
            continue
        default = msgspec.NODEFAULT if field.default is MISSING else field.default
        declared.append((field.name, hints[field.name], default))
    return declared


class MessageFilter:
    """Filter of the messages that a server receives from its pages.

    Attributes:
        notify: function that shows a notice to the users.
        read: number of accepted messages.
        dropped: number of dropped messages.
    """

    def __init__(self) -> None:
        self.notify: Callable[[str], object] = lambda text: None
        self.read = 0
        self.dropped = 0
        self._gui: viser.GuiApi | None = None
        self._upload: _Upload | None = None
        self._last_notice = -math.inf
        self._ordinary = _decoder(_ORDINARY_MESSAGES)
        self._long = _decoder(_LONG_MESSAGES)

    def set_server(self, server: viser.ViserServer) -> None:
        """Set the server; messages may only refer to its page elements. Before this call, all messages are dropped.

        Raises:
            TwinError: this version of viser stores the page elements in an unsupported way.
        """
        # Not a public name of viser: a version without it is refused, instead of a filter that accepts everything.
        handles = getattr(server.gui, "_gui_input_handle_from_uuid", None)
        if not isinstance(handles, dict):
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
        message = self._decode(raw)
        if self._gui is None:
            raise StaleError("there is no page yet")
        # A decoded message has the name and the fields of its type in viser, but is no instance of it.
        type_name = type(message).__name__
        if type_name == "FileTransferPart":
            self._add_part(cast(viser_messages.FileTransferPart, message), sender)
        elif type_name == "FileTransferStartUpload":
            self._begin_upload(cast(viser_messages.FileTransferStartUpload, message), sender, now)
        elif type_name == "GetRenderResponseMessage":
            _check_picture(cast(viser_messages.GetRenderResponseMessage, message).payload)
        else:
            _check_numbers(message)
            if type_name == "GuiUpdateMessage":
                self._check_element(cast(viser_messages.GuiUpdateMessage, message))

    def _decode(self, raw: bytes) -> msgspec.Struct:
        """Return a message as a structure with the name and the fields of its type in viser.

        Raises:
            NonsenseError: the message has no accepted type, or its fields are not those of its type.
        """
        if len(raw) > MAX_ORDINARY_BYTES:
            try:
                return self._long.decode(raw)
            except _DECODING_ERRORS:
                raise NonsenseError(f"unknown message of {len(raw)} bytes") from None
        try:
            return self._ordinary.decode(raw)
        except _DECODING_ERRORS:
            pass
        try:  # a small message may also be the last part of a file, or a picture
            return self._long.decode(raw)
        except _DECODING_ERRORS as error:
            raise NonsenseError(str(error)) from None

    # -- elements -------------------------------------------------------------------------------------

    def _element(self, uuid: str) -> _PageElement:
        """Return the page element with an identifier.

        Raises:
            StaleError: there is no such element, or it is disabled.
        """
        assert self._gui is not None
        element = self._gui._gui_input_handle_from_uuid.get(uuid)
        if element is None or getattr(element, "disabled", False):
            raise StaleError("the element was removed, or is disabled")
        return element

    def _check_element(self, message: viser_messages.GuiUpdateMessage) -> None:
        """Check that a message sets the value of a page element to one that a user can choose."""
        if list(message.updates) != ["value"]:
            raise NonsenseError(f"a message may update only 'value', not {list(message.updates)[:3]}")
        element = self._element(message.uuid)
        value = message.updates["value"]
        if isinstance(element, viser.GuiUploadButtonHandle):
            raise NonsenseError("a message must not set the value of an upload button")
        if not _is_possible(element, value):
            raise NonsenseError("the value has the wrong type for its element")

    # -- files ----------------------------------------------------------------------------------------

    def _begin_upload(self, message: viser_messages.FileTransferStartUpload, sender: Sender, now: float) -> None:
        element = self._element(message.source_component_uuid)
        if not isinstance(element, viser.GuiUploadButtonHandle):
            raise NonsenseError("the element accepts no upload")
        if message.size_bytes > MAX_UPLOAD_BYTES:
            megabytes = message.size_bytes / 1e6
            self._tell(f"the file has {megabytes:.0f} MB; at most {MAX_UPLOAD_BYTES / 1e6:.1f} MB are accepted", now)
            raise StaleError("the file is too large")
        if message.size_bytes < 1 or message.part_count < 1:
            raise NonsenseError("the file is empty")
        unfinished = self._upload
        if unfinished is not None:
            if now - unfinished.start_time < UPLOAD_TIMEOUT:
                self._tell("another file is being loaded: wait until it is done", now)
                raise StaleError("another upload is in progress")
            unfinished.sender.cut()
        self._upload = _Upload(
            sender=sender,
            transfer=message.transfer_uuid,
            source=message.source_component_uuid,
            remaining_bytes=message.size_bytes,
            remaining_parts=message.part_count,
            start_time=now,
        )

    def _tell(self, text: str, now: float) -> None:
        """Show the users a notice, at most one per `_NOTICE_PAUSE` seconds."""
        if now - self._last_notice > _NOTICE_PAUSE:
            self._last_notice = now
            self.notify(text)

    def _add_part(self, message: viser_messages.FileTransferPart, sender: Sender) -> None:
        upload = self._upload
        if upload is None or upload.sender is not sender or message.transfer_uuid != upload.transfer:
            raise StaleError("a part of a file arrived, but no upload was started")  # the upload was refused
        upload.remaining_bytes -= len(message.content)
        upload.remaining_parts -= 1
        in_order = message.part_index == upload.next_part and message.source_component_uuid == upload.source
        too_much = upload.remaining_bytes < 0 or upload.remaining_parts < 0
        ends_early = (upload.remaining_parts == 0) != (
            upload.remaining_bytes == 0
        )  # the last part must bring the last byte
        if not in_order or too_much or ends_early:
            self._upload = None
            sender.cut()  # disconnecting makes viser drop the received parts
            raise NonsenseError("a part of a file has the wrong number or size for the upload in progress")
        upload.next_part += 1
        if upload.remaining_parts == 0:
            self._upload = None


def _check_numbers(value: object, name: str = "") -> None:
    """Raise `NonsenseError` if a message has a number beyond `_MAX_NUMBER` or a quaternion far from length 1."""
    if isinstance(value, msgspec.Struct):
        for field in value.__struct_fields__:
            _check_numbers(getattr(value, field), field)
    elif isinstance(value, dict):
        for inner in value.values():
            _check_numbers(inner)
    elif isinstance(value, list | tuple):
        for inner in value:
            _check_numbers(inner)
        if name == "wxyz" and not 0.9 < math.hypot(*value) < 1.1:
            raise NonsenseError("the orientation is invalid")
    elif isinstance(value, int | float) and not abs(value) <= _MAX_NUMBER:  # also true for NaN
        raise NonsenseError(f"{name} = {value}")


def _is_possible(element: _PageElement, value: object) -> bool:
    """Return whether a value from a page is possible for an element: an option, or of the type of its value."""
    current = element.value
    options = getattr(element, "options", None)
    if options is not None:
        return value in tuple(options)
    if isinstance(current, bool):  # before int, of which bool is a subclass
        return isinstance(value, bool)
    if isinstance(current, int | float):
        # Values from the keyboard may be outside the range of a slider; they are clamped.
        return isinstance(value, int | float) and not isinstance(value, bool)
    if isinstance(current, str):
        return isinstance(value, str) and len(value) <= _MAX_TEXT_LENGTH
    if isinstance(current, tuple):
        return _is_vector(value, len(current))
    return False


def _is_vector(value: object, length: int) -> bool:
    if not isinstance(value, list | tuple) or len(value) != length:
        return False
    # The exact type: True is an instance of int.
    return all(type(number) in (int, float) for number in value)


def _check_picture(png: bytes) -> None:
    """Raise `NonsenseError` if a picture is not PNG or is too large."""
    # The first chunk of a PNG file is IHDR: after length and name come width and height, 4 bytes each.
    width = int.from_bytes(png[16:20], "big")
    height = int.from_bytes(png[20:24], "big")
    if png[:8] != b"\x89PNG\r\n\x1a\n" or not 0 < width * height <= _MAX_PIXELS:
        raise NonsenseError("the picture is not PNG, or is too large")
