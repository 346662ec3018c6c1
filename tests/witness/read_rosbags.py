"""rosbags: the messages of a recording with the messages of ROS 2.

    read_rosbags.py FILE

The answer: {"types": {topic: type}, "messages": {topic: [[time in ns, plain data], …]}}. The definitions are those in
the file, and must be those that the library has itself.
"""

import dataclasses
import json
import sys
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore


def plain(value):
    if dataclasses.is_dataclass(value):
        fields = [field.name for field in dataclasses.fields(value) if not field.name.startswith("__")]
        return {name: plain(getattr(value, name)) for name in fields}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list):
        return [plain(item) for item in value]
    return value


own = get_typestore(Stores.ROS2_JAZZY)
types = {}
messages = {}
with AnyReader([Path(sys.argv[1])]) as reader:
    for connection, time, data in reader.messages():
        types[connection.topic] = connection.msgtype
        told = plain(reader.deserialize(data, connection.msgtype))
        assert told == plain(own.deserialize_cdr(data, connection.msgtype)), connection.topic
        messages.setdefault(connection.topic, []).append([time, told])
print(json.dumps({"types": types, "messages": messages}), flush=True)
