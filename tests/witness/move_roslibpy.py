"""roslibpy: a hand of `twin serve --ros` moves by 10 mm; where the instrument goes.

    move_roslibpy.py PORT

The answer: {"topics": {topic: type}, "version", "before", "after": position (3,) of /PSM1/setpoint_cp in m,
"joints": the last /PSM1/measured_js, "states": the words of /PSM1/operating_state, "frames": number of /tf}.
"""

import json
import math
import sys
import time

import roslibpy

STEP = 0.01
"""Pause in s between two poses: the device of the console is silent after 0.25 s."""

seen = {}
states = []
frames = []


def position():
    p = seen["/PSM1/setpoint_cp"]["pose"]["position"]
    return [p["x"], p["y"], p["z"]]


def pose(x, roll):
    q = {"x": 0.0, "y": 0.0, "z": math.sin(roll / 2), "w": math.cos(roll / 2)}
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}},
        "pose": {"position": {"x": x, "y": 0, "z": 0}, "orientation": q},
    }


client = roslibpy.Ros("127.0.0.1", int(sys.argv[1]))
client.run(timeout=60)
listing = client.get_topics()
types = {topic: client.get_topic_type(topic) for topic in listing}
for name in ("/PSM1/setpoint_cp", "/PSM1/measured_js"):
    roslibpy.Topic(client, name, types[name]).subscribe(lambda message, name=name: seen.update({name: message}))
roslibpy.Topic(client, "/PSM1/operating_state", types["/PSM1/operating_state"]).subscribe(
    lambda message: states.append((message["state"], message["is_busy"]))
)
roslibpy.Topic(client, "/tf", types["/tf"]).subscribe(lambda message: frames.append(len(message["transforms"])))
right = roslibpy.Topic(client, "/MTMR/measured_cp", types["/MTMR/measured_cp"])
left = roslibpy.Topic(client, "/MTML/measured_cp", types["/MTML/measured_cp"])


def send(x, roll):
    right.publish(roslibpy.Message(pose(x, roll)))
    left.publish(roslibpy.Message(pose(-0.08, roll)))
    time.sleep(STEP)


def hold(x, roll, ready):
    """Send the same poses until `ready` is true for 30 sends in succession."""
    good = 0
    for _ in range(6000):
        send(x, roll)
        good = good + 1 if ready() else 0
        if good == 30:
            return
    raise SystemExit(f"not ready; seen {sorted(seen)}, states {states[-3:]}")


hold(0.08, 0.0, lambda: "/PSM1/setpoint_cp" in seen)
hold(0.08, math.radians(5), lambda: bool(states) and states[-1][1])
before = position()
for k in range(1, 101):
    send(0.08 + 0.0001 * k, math.radians(5))
last = []


def still():
    last.append(position())
    return len(last) > 1 and last[-1] == last[-2]


hold(0.09, math.radians(5), still)
answer = {
    "topics": types,
    "version": f"roslibpy {roslibpy.__version__}",
    "before": before,
    "after": position(),
    "joints": seen["/PSM1/measured_js"],
    "states": sorted({state for state, _ in states}),
    "frames": len(frames),
}
client.close()
print(json.dumps(answer), flush=True)
