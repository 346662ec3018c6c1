"""Joint states of a mechanism, sampled from its whole range, at which files without motion are played."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.exchange.audit.file_content import FileClip
from twin.exchange.audit.poses import Array

CLIP = "drawn joint states"
"""Name of the clip of the sampled states; reports show it."""


@dataclass(frozen=True)
class SampledStates:
    """Sampled states of a mechanism with closed loops.

    Attributes:
        joints: {joint: values (k,) in m or rad} of the joints with one coordinate.
        links: {body: T_world_body (k, 4, 4)}.
    """

    joints: Mapping[str, Array]
    links: Mapping[str, Array]

    def clip(self) -> FileClip:
        """Return the states as a clip, one state per second."""
        return FileClip(CLIP, np.arange(self.count, dtype=float), self.links, self.joints)

    @property
    def count(self) -> int:
        """Number of states."""
        return len(next(iter(self.links.values())))
