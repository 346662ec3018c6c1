"""Poses of the prims of a stage, in a world frame in metres with z up, and the time codes of their samples."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from pxr import Usd, UsdGeom

from twin.exchange.audit import poses
from twin.exchange.audit.poses import Array


class StageWorld:
    """Conversion of a stage's poses to a world frame in metres with z up."""

    def __init__(self, stage: Usd.Stage) -> None:
        self.meters = float(UsdGeom.GetStageMetersPerUnit(stage))
        self.up = str(UsdGeom.GetStageUpAxis(stage))
        self._R = np.eye(3)
        if self.up == "Y":
            self._R = poses.R_Z_UP_Y_UP
        self._cache = UsdGeom.XformCache()

    def maps(self, prims: Sequence[Usd.Prim], codes: Sequence[Usd.TimeCode]) -> Array:
        """Return T_stage_prim (n, k, 4, 4) of n prims at k time codes, with scale, in the stage's units and axes."""
        matrices = np.zeros((len(prims), len(codes), 4, 4))
        for k, code in enumerate(codes):  # time is the outer loop, because SetTime clears the cache
            self._cache.SetTime(code)
            for i, prim in enumerate(prims):
                matrices[i, k] = self._cache.GetLocalToWorldTransform(prim)
        return np.swapaxes(matrices, -1, -2)  # Gf matrices act on row vectors

    def poses(self, prim: Usd.Prim, codes: Sequence[Usd.TimeCode]) -> Array:
        """Return the poses T_world_prim (k, 4, 4) of a prim at the time codes, in metres, z up."""
        return self.placed(self.maps([prim], codes)[0])

    def placed(self, M: Array) -> Array:
        """Convert matrices T_stage_prim (..., 4, 4) to poses T_world_prim (..., 4, 4) in metres, z up."""
        T, _ = poses.split(M)
        T[..., :3, 3] *= self.meters
        return poses.pose(self._R) @ T

    def along(self, prims: dict[str, Usd.Prim], codes: Array) -> dict[str, Array]:
        """Return {name in `prims`: T_world_prim (k, 4, 4)} at k time codes, in metres with z up."""
        times = list(map(Usd.TimeCode, codes.tolist()))
        # Most prims do not move: evaluating them at every time code would take most of the time.
        moving = {}
        for name, prim in prims.items():
            if time_codes(prim):
                moving[name] = prim
        poses_of_moving = self.placed(self.maps(list(moving.values()), times))
        poses_by_name = dict(zip(moving, poses_of_moving, strict=True))
        placed = {}
        for name, prim in prims.items():
            if name in poses_by_name:
                placed[name] = poses_by_name[name]
            else:
                placed[name] = np.broadcast_to(self.poses(prim, times[:1]), (len(codes), 4, 4))
        return placed


def time_codes(prim: Usd.Prim) -> list[float]:
    """Return the time codes at which a prim or one of its ancestors has samples."""
    codes: set[float] = set()
    while prim and not prim.IsPseudoRoot():
        if prim.IsA(UsdGeom.Xformable):
            codes.update(UsdGeom.Xformable(prim).GetTimeSamples())
        prim = prim.GetParent()
    return sorted(codes)


def all_time_codes(prims: Iterable[Usd.Prim]) -> Array:
    """Return the time codes (k,) at which one of the prims or of their ancestors has samples."""
    codes: set[float] = set()
    for prim in prims:
        codes.update(time_codes(prim))
    return np.array(sorted(codes))
