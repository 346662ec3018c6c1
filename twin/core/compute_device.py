"""Whether kernels are computed by the processor or by a graphics processor (GPU), and which one has computed.

The choice holds for all kernels that are called in a block, as the limit of processors holds for a process: most
functions that compute many samples call kernels of several rooms.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Literal, get_args

from twin.core.errors import TwinError, unknown

Choice = Literal["auto", "cpu", "gpu"]
"""The processor; a GPU; or ("auto") a GPU where it is expected to be faster, copying included."""

CHOICES: tuple[Choice, ...] = get_args(Choice)

DEVICE = "TWIN_DEVICE"
"""Environment variable with the choice outside of `computing_on`, and that of commands without --device."""

PROCESSOR = "processor"
"""Name of the processor in results."""


@dataclass
class ComputeDevice:
    """The choice for the kernels of a block, and what has computed them.

    Attributes:
        choice: see `Choice`.
        used: names of the GPUs that have computed a kernel in the block.
    """

    choice: Choice
    used: set[str] = field(default_factory=set)

    @property
    def name(self) -> str:
        """What has computed, for results: the names of the GPUs, else "processor"."""
        return ", ".join(sorted(self.used)) or PROCESSOR


_of_environment: dict[str, ComputeDevice] = {}
"""What has computed outside of `computing_on`, by the choice in the environment."""

_current: ContextVar[ComputeDevice | None] = ContextVar("compute device", default=None)


@contextmanager
def computing_on(choice: Choice) -> Iterator[ComputeDevice]:
    """Let kernels that this thread calls in the block be computed by "cpu", "gpu" or "auto" (see `Choice`).

    With "gpu", a `GpuError` is raised if there is no GPU. The processor still computes a few samples (fewer than 4096),
    kernels that take results of the sample before, and those that call the C library or must equal CasADi bit for bit.

    Raises:
        TwinError: there is no such choice.

    Examples:
        >>> import twin
        >>> with twin.computing_on("cpu") as device:
        ...     poses = twin.load("pa10").forward([[0.0] * 7])
        >>> device.name
        'processor'
    """
    device = ComputeDevice(checked(choice))
    token = _current.set(device)
    try:
        yield device
    finally:
        _current.reset(token)


def current() -> ComputeDevice:
    """Return the choice that holds now: without a block, that of the environment, else "cpu".

    Raises:
        TwinError: `TWIN_DEVICE` is none of the choices.
    """
    device = _current.get()
    if device is None:
        choice = of_environment("cpu")
        if choice not in _of_environment:
            _of_environment[choice] = ComputeDevice(choice)
        return _of_environment[choice]
    return device


def of_environment(default: Choice) -> Choice:
    """Return the choice of the environment variable `TWIN_DEVICE`; `default` if it is unset or empty.

    Raises:
        TwinError: `TWIN_DEVICE` is none of the choices.
    """
    text = os.environ.get(DEVICE)
    if not text:
        return default
    try:
        return checked(text)
    except TwinError as e:
        raise TwinError(f"environment variable {DEVICE}: {e}") from None


def checked(choice: str) -> Choice:
    """Return a choice.

    Raises:
        TwinError: there is no such choice.
    """
    for known in CHOICES:
        if choice == known:
            return known
    raise TwinError(unknown("compute device", choice, CHOICES))
