"""Distances of joints that a page changes in the mechanism: the design is not saved, and meshes keep their shape."""

from __future__ import annotations

from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.units import MM
from twin.model.joint_distance import kinematic_distances, with_distance
from twin.ui.session.movable_robot import MovableRobot

_MAX_CHANGE_FRACTION = 0.25
"""Largest change of a distance that a page offers, as a fraction of the distance as drawn."""


class ChangedDistances:
    """The distances of a movable robot's mechanism, and those that have been changed.

    Attributes:
        values: {index in `distances`: value in m} of the distances that are not as drawn.
    """

    def __init__(self, movable: MovableRobot) -> None:
        self._movable = movable
        self._distances = kinematic_distances(movable.robot.mechanism)
        self.values: dict[int, float] = {}

    def describe(self) -> list[JsonObject]:
        """Return name, drawn value and range in m of each distance."""
        entries: list[JsonObject] = []
        for distance in self._distances:
            drawn_distance = distance.distance
            entries.append(
                {
                    "name": f"{distance.body}: {distance.joint} to {distance.other}",
                    "drawn": drawn_distance,
                    "lower": (1 - _MAX_CHANGE_FRACTION) * drawn_distance,
                    "upper": (1 + _MAX_CHANGE_FRACTION) * drawn_distance,
                }
            )
        return entries

    def __len__(self) -> int:
        return len(self._distances)

    def change(self, index: int | None, value: float | None) -> str:
        """Set a distance to a value in m, or to its drawn value (None); all distances with `index` None.

        Return why the mechanism cannot be assembled with it, in which case nothing is changed; "" if it can.
        """
        new_values = dict(self.values)
        what = "the mechanism as drawn"
        if index is None:
            new_values = {}
        elif value is None:
            new_values.pop(index, None)
        else:
            new_values[index] = value
            distance = self._distances[index]
            what = f"{distance.body}, {distance.joint} to {distance.other} = {value / MM:g} mm"
        mechanism = self._movable.robot.mechanism
        try:
            for i, length in new_values.items():
                distance = self._distances[i]
                mechanism = with_distance(mechanism, distance.joint, distance.other, length)
            self._movable.redesign(mechanism)
        except TwinError as error:
            return f"{what}: {error}"
        self.values = new_values
        return ""
