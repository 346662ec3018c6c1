"""The loop of a viser page: one thread handles requests and draws, so that all browsers show the same state.

Callbacks of the page only store requests; a new request replaces an earlier one of the same kind, so that fast input
does not queue up.
"""

from __future__ import annotations

import logging
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable

import viser

from twin.core.errors import TwinError
from twin.ui.viewer.server import stop, tell

FRAME_PERIOD = 1 / 60
"""Duration in s of a display frame."""

NOTICE_PAUSE = 3.0
"""Minimum time in s before the same notice is shown again; a refused drag causes the same notice in every frame."""


class ViewerPage(ABC):
    """Base class of a page of the viewer; one thread handles all requests and draws all frames.

    Attributes:
        stopping: event that ends the loop when it is set.
        now: time in s of the present frame on the clock of `time.perf_counter`.
    """

    def __init__(self, server: viser.ViserServer, title: str, stopping: threading.Event | None = None) -> None:
        self.server, self.title = server, title
        self.stopping = threading.Event() if stopping is None else stopping
        self._requests: dict[str, Callable[[], object]] = {}
        self._lock = threading.Lock()
        self._last = self.now = time.perf_counter()
        self._notice_times = "", -NOTICE_PAUSE

    @abstractmethod
    def frame(self, passed: float, has_requests: bool) -> None:
        """Draw one frame.

        Args:
            passed: time in s since the last frame.
            has_requests: whether a request was handled since the last frame.
        """

    def ask(self, kind: str, request: Callable[[], object]) -> None:
        """Store a request for the loop; the request replaces an earlier one of the same kind."""
        with self._lock:
            self._requests.pop(kind, None)
            self._requests[kind] = request

    def repeat(self, kind: str, step: Callable[[], bool]) -> None:
        """Store a request `step`, which is repeated in each frame until it returns False.

        A new request of the same kind ends the repetition, too.
        """

        def request() -> None:
            if step():
                with self._lock:
                    self._requests.setdefault(kind, request)

        self.ask(kind, request)

    def has_requests(self, kind: str) -> bool:
        """Return whether a request of a kind that begins with `kind` is waiting; if so, leave its control unchanged."""
        with self._lock:
            return any(k.startswith(kind) for k in self._requests)

    def run(self) -> None:
        """Draw frames until `stop` is called or `stopping` is set."""
        try:
            while not self.stopping.is_set():
                start = time.perf_counter()
                self.step()
                self.stopping.wait(max(0.001, FRAME_PERIOD - (time.perf_counter() - start)))
        finally:
            self.close()

    def step(self) -> None:
        """Handle requests, then draw one frame."""
        now = time.perf_counter()
        passed, self._last, self.now = now - self._last, now, now
        with self._lock:
            requests, self._requests = self._requests, {}
        for request in requests.values():
            try:
                request()
            except TwinError as error:
                self.say(str(error), bad=True)
            except Exception as error:  # an error in a request must not end the loop
                logging.getLogger(__name__).exception("a request failed")
                self.say(f"internal error, {type(error).__name__}: {error}. Please report it.", bad=True)
        self.frame(passed, bool(requests))

    def stop(self) -> None:
        """End the loop."""
        self.stopping.set()

    def close(self) -> None:
        """End the loop and release the port."""
        self.stopping.set()
        stop(self.server)

    def say(self, text: str, bad: bool = False) -> None:
        """Show a notice in every browser; the same notice is not shown again within `NOTICE_PAUSE` s."""
        if self._notice_times[0] != text or self.now - self._notice_times[1] > NOTICE_PAUSE:
            self._notice_times = text, self.now
            tell(self.server, self.title, text, bad)
