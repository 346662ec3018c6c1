"""Run tasks on other processors through a Dask scheduler; the scheduler runs at an address, or is started locally.

Each result is returned when its task is finished. If a worker dies, other workers rerun the unfinished tasks.
"""

from __future__ import annotations

import contextlib
import logging
import signal
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator
from types import FrameType
from typing import TYPE_CHECKING, TypedDict, TypeVar

from twin.core.atomic import Scratch
from twin.core.compute_device import Choice
from twin.core.errors import TwinError
from twin.core.extras import require
from twin.core.jobs import usable_processors
from twin.core.processes import spawning_children

if TYPE_CHECKING:
    from distributed import Client

TaskResult = TypeVar("TaskResult")

LOCAL = "local"
"""Value of --scheduler that starts local workers, one for each processor."""

_CONNECTION_TIMEOUT = "10s"
"""Maximum time to wait for a scheduler, as text for Dask."""


class Processes(TypedDict, total=False):
    """Keyword arguments of functions that can compute on other machines.

    Attributes:
        scheduler: address of a Dask scheduler, or "local"; default: this machine.
        source: name or path by which workers load the robot; default: the given name or path, or the robot's folder.
    """

    scheduler: str | None
    source: str | None


class DeviceProcesses(Processes, total=False):
    """Keyword arguments of functions that always compute in several processes; see also `Processes`.

    Attributes:
        workers: number of local processes; default: one for each processor.
        device: what computes in each process, see `twin.core.compute_device`; default: "cpu".
    """

    workers: int | None
    device: Choice


def require_keys(function: str, given: Processes, kind: type[Processes]) -> None:
    """Raise a TypeError if `given` has keyword arguments that the named function does not take."""
    known_keys = kind.__annotations__
    for name in given:
        if name not in known_keys:
            others = ", ".join(known_keys)
            raise TypeError(f"{function}() got an unexpected keyword argument '{name}'; it also takes: {others}")


@contextlib.contextmanager
def cluster(address: str = LOCAL, workers: int | None = None) -> Iterator[Client]:
    """Yield a client of the scheduler at `address`, such as tcp://10.0.0.1:8786, or of a local scheduler ("local").

    A local scheduler starts `workers` workers; None: one for each processor.

    Raises:
        TwinError: no scheduler answers at the address, the scheduler has no workers, or `distributed` is missing.
    """
    require("distributed", "work on several processors or machines")
    import dask
    from distributed import Client, LocalCluster

    logging.getLogger("distributed").setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # warnings about dashboard ports and slow starts do not affect results
        if address == LOCAL:
            count = workers or usable_processors()
            # Workers listen on the loopback address only, and no dashboard is served.
            options = {"threads_per_worker": 1, "host": "127.0.0.1", "dashboard_address": ""}
            with Scratch() as scratch, contextlib.ExitStack() as stack:
                settings = {
                    "distributed.worker.daemon": False,
                    # Workers that are stopped would print warnings about their tasks.
                    "distributed.nanny.pre-spawn-environ.DASK_LOGGING__DISTRIBUTED": "critical",
                    "temporary-directory": scratch,
                }
                stack.enter_context(dask.config.set(settings))
                stack.enter_context(spawning_children())
                with _delayed_interrupt():
                    local_cluster = stack.enter_context(LocalCluster(count, **options))
                    client = stack.enter_context(Client(local_cluster))
                try:
                    yield client
                finally:
                    # The local scheduler reports, as critical, each task that is unfinished when the client leaves.
                    logging.getLogger("distributed").setLevel(logging.CRITICAL + 1)
            return
        try:
            client = Client(address, timeout=_CONNECTION_TIMEOUT)
        except (OSError, TimeoutError, ValueError) as error:
            raise TwinError(f"--scheduler {address}: no Dask scheduler answers at this address ({error})") from error
        with client:
            if not client.scheduler_info()["workers"]:
                raise TwinError(f"--scheduler {address}: the scheduler has no workers; start: dask worker {address}")
            yield client


@contextlib.contextmanager
def _delayed_interrupt() -> Iterator[None]:
    """Delay the first Ctrl-C to the end of the `with` block; otherwise, half-started workers would keep running."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    interrupts: list[int] = []

    def delay(number: int, frame: FrameType | None) -> None:
        if interrupts:  # a second Ctrl-C is not delayed
            signal.default_int_handler(number, frame)
        interrupts.append(number)

    handler_before = signal.signal(signal.SIGINT, delay)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler_before)
    if interrupts:
        raise KeyboardInterrupt


def each(
    client: Client, function: Callable[..., TaskResult], tasks: Iterable[tuple[object, ...]]
) -> Iterator[tuple[int, TaskResult]]:
    """Yield (task index, result) of each finished task, in any order.

    `function` is at the top level of a module that the workers can import. It must return the same result for the same
    arguments, because a task may run more than once.

    Raises:
        Exception: the error that a task raised.
    """
    from distributed import as_completed

    futures = {}
    for i, task in enumerate(tasks):
        future = client.submit(function, *task, pure=False, retries=3)
        futures[future] = i
    for future in as_completed(futures):
        yield futures[future], future.result()
