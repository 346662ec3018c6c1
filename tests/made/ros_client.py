"""A client of the protocol rosbridge v2, written for tests; it stores all that it receives."""

from __future__ import annotations

import asyncio
import json
from contextlib import asynccontextmanager, suppress

import numpy as np
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

from twin.core import spatial
from twin.core.units import DEG

HANDS = {"right": "MTMR", "left": "MTML"}


class RosClient:
    """Connection of a client.

    Attributes:
        heard: {topic: messages}, in the order of their arrival.
        statuses: status messages (level, text).
        binary: number of binary messages.
    """

    def __init__(self, ws):
        self.ws = ws
        self.heard = {}
        self.statuses = []
        self.binary = 0
        self._answers = {}
        self._number = 0
        self._reader = asyncio.ensure_future(self._read())

    async def _read(self):
        with suppress(ConnectionClosed):
            async for data in self.ws:
                self._take(data)

    def _take(self, data):
        if isinstance(data, bytes):
            import cbor2

            self.binary += 1
            document = cbor2.loads(data)
        else:
            document = json.loads(data)
        match document["op"]:
            case "publish":
                self.heard.setdefault(document["topic"], []).append(document["msg"])
            case "status":
                self.statuses.append((document["level"], document["msg"]))
            case "service_response":
                self._answers.pop(document["id"]).set_result(document)

    async def send(self, op, **more):
        await self.ws.send(json.dumps({"op": op, **more}))

    async def publish(self, topic, msg):
        await self.send("publish", topic=topic, msg=msg)

    async def call(self, service, **args):
        """Return the answer of a service; all messages sent before it have then been handled."""
        self._number += 1
        answer = self._answers[f"call{self._number}"] = asyncio.get_running_loop().create_future()
        await self.send("call_service", service=service, args=args, id=f"call{self._number}")
        return await answer

    async def handled(self):
        await self.call("/rosapi/get_time")

    async def pose(self, topic, T):
        await self.publish(topic, stamped(T))


def stamped(T):
    """Return geometry_msgs/PoseStamped of a pose (4, 4)."""
    w, x, y, z = spatial.quat_from_matrix_wxyz(T[:3, :3]).tolist()
    px, py, pz = T[:3, 3].tolist()
    pose = {"position": {"x": px, "y": py, "z": pz}, "orientation": {"x": x, "y": y, "z": z, "w": w}}
    return {"header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}, "pose": pose}


def placed(message):
    """Return the pose (4, 4) in geometry_msgs/PoseStamped."""
    p = message["pose"]["position"]
    q = message["pose"]["orientation"]
    R = spatial.matrix_from_quat_wxyz([q["w"], q["x"], q["y"], q["z"]])
    return spatial.pose(R, [p["x"], p["y"], p["z"]])


class RosPens:
    """Both handles as a ROS program sends them; poses in {H}, as those of `made.pens.Pens`."""

    def __init__(self, client):
        self.client = client
        self.p = {"right": np.array([0.08, 0, 0]), "left": np.array([-0.08, 0, 0])}
        self.R = {side: np.eye(3) for side in HANDS}

    async def send(self):
        for side, name in HANDS.items():
            await self.client.pose(f"/{name}/measured_cp", spatial.pose(self.R[side], self.p[side]))

    def roll(self):
        for side in HANDS:
            self.R[side] = self.R[side] @ spatial.rotation_z(5 * DEG)


@asynccontextmanager
async def connected(port, path="/", **more):
    """Yield a client of a bridge on a port of this machine."""
    async with connect(f"ws://127.0.0.1:{port}{path}", **more) as ws:
        yield RosClient(ws)
