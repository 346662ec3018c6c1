"""A C# file with the kinematics of one robot, for a headset without a computer beside it."""

from twin.exchange.formats.unity.kinematics.csharp_file import class_name, source
from twin.exchange.formats.unity.kinematics.csharp_values import DeviceModel

__all__ = ["DeviceModel", "class_name", "source"]
