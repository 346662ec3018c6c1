"""A planned protocol as it is streamed: its samples with the poses of all links, and the tip path for new clients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.json_types import JsonObject
from twin.core.sampling import spread
from twin.core.spatial import Array
from twin.ui.session.timeline import Playback

MAX_PATH_POINTS = 600
"""Maximum number of points in a sent tip path."""


@dataclass(frozen=True, eq=False)
class StreamedPlayback:
    """A playback with k samples, and the link poses that are displayed at each of them.

    Attributes:
        playback: the playback.
        poses: (k, links, 7) poses of the links in base: x y z in m, quaternion x y z w.
    """

    playback: Playback
    poses: Array


def path_document(streamed: StreamedPlayback | None) -> JsonObject:
    """Return the document `path`: the protocol's name and its tip path; without a protocol, no points.

    The points are x y z in m, in base, one after another in a flat list.
    """
    if streamed is None:
        return {"type": "path", "protocol": None, "points": []}
    tip = streamed.playback.tip
    rows = spread(len(tip), MAX_PATH_POINTS)
    points = np.round(tip[rows], 6)  # to 0.001 mm, which is finer than any display shows
    return {"type": "path", "protocol": streamed.playback.protocol, "points": points.ravel().tolist()}
