"""The server by itself, light to import: a browser can load the page while the robot is being read."""

from __future__ import annotations

import contextlib
import io
import logging

import viser


def serve(title: str, host: str, port: int) -> viser.ViserServer:
    """Return a running server on a port that is free; 0 takes any."""
    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # browsers open sockets that they never use
    with contextlib.redirect_stdout(io.StringIO()):
        return viser.ViserServer(host=host, port=port, label=title, verbose=False)


def stop(server: viser.ViserServer) -> None:
    """Stop a server without a word."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()
