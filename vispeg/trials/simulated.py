"""A simulated robot with the hidden effects of its world: as an object, or in a process behind a loopback socket."""

from __future__ import annotations

import json
import select
import socket
import sys
import time
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.render.image_kinds import DEPTH, camera_of, kind_of
from vispeg.task.environments.vector import TaskVec
from vispeg.trials.wire import receive, send
from vispeg.worlds.model_file import without_origin

BEHIND = 0.05  # s; with a larger delay behind the clock, the robot does not catch up but skips the lost time


class SimulatedRobot:
    """One robot, advanced one control period at a time.

    Args:
        world: a built-in world's name, or a world file.
        obs_mode: observation mode: which pictures there are, and whether the goal is observed.
        settings: settings of the task, such as the policy's cameras.
    """

    def __init__(self, world: str, obs_mode: str, settings: Mapping[str, Any]):
        self.env = TaskVec(1, world, obs_mode, autoreset_mode="Disabled", **settings)
        self.sim, self.config = self.env.sim, self.env.config
        self.ticks = 0

    @property
    def time(self) -> float:
        """Simulated time since the episode began, s."""
        return self.ticks * self.config.control_period

    def begin(self, seed: int) -> dict[str, Any]:
        """Begin an episode; return its start as in trial.yaml, without the joints."""
        self.env.reset(seed=[seed])
        sim = self.sim
        self.ticks, self.ended = 0, None
        self._force, self._felt = [], []
        self.measured = self._measured()
        at_rest = sim.seen.chain.rotation(self.measured[0])[0].T @ sim.seen.weight
        self.wrench = np.concatenate([at_rest, np.zeros(3)])
        return {
            "goal_m": sim.cell.site_position("goal")[0].tolist(),
            "believed_m": sim.seen.believed[0].tolist(),
            "effects": [dict(without_origin(e)) for e in sim.drawn[0].effects],
        }

    def tick(self) -> None:
        """Advance by one control period; judge the episode a policy period after it was last judged."""
        sim, n = self.sim, self.config.ticks
        felt, force = sim.tick(len(self._felt), self.measured)
        self.wrench = felt[0].copy()
        self._felt.append(felt.copy())
        self._force.append(force.copy())
        sim.cell.read()
        self.measured = self._measured()
        self.ticks += 1
        if len(self._force) == n:
            self._judge()

    def _measured(self) -> tuple[np.ndarray, np.ndarray]:
        """Read the encoders: angles and velocities (1, nj), rad and rad/s. Call this once per control period."""
        q, dq = self.sim.cell.measure()
        return q.copy(), dq.copy()

    def _judge(self) -> None:
        """Let the task judge the time since it last did."""
        self.sim.seen.see(*self.measured)
        _, terminated, _, records = self.sim.settle(np.array(self._force), np.array(self._felt))
        if terminated[0]:  # a timeout is left to the run loop: its clock starts with the policy and may run slower
            self.ended = self.ended or records[0]
        self._force, self._felt = [], []

    def hold(self, pose: np.ndarray) -> None:
        """Command the flange to `pose` (7,): m, quaternion w x y z, in the base."""
        self.sim.seen.goal[0], self.sim.seen.rot[0] = pose[:3], pose[3:]

    def rest(self) -> None:
        """Command the flange to stay where it is."""
        seen = self.sim.seen
        pos, rot, _, _ = seen.chain.pose(*self.measured)
        self.hold(np.concatenate([pos[0], rot[0]]))

    def reading(self) -> dict[str, np.ndarray]:
        """Return the newest `q` (nj,), `dq` (nj,) and `wrench` (6,), in SI units."""
        q, dq = self.measured
        return {"q": q[0], "dq": dq[0], "wrench": self.wrench}

    def pictures(self, cameras: Sequence[str]) -> dict[str, np.ndarray]:
        """Return pictures of these cameras, key of the observation -> (H, W) depth in m or (H, W, 3) uint8."""
        if not cameras:
            return {}
        self.env.look([0])
        out = {}
        for key, image in self.env.eyes.see().items():
            if camera_of(key) in cameras:
                out[key] = image[0, 0] if kind_of(key) is DEPTH else np.moveaxis(image[0], 0, -1)
        return out

    def over(self) -> bool:
        """Return whether the episode has ended; call it at the end of a policy period.

        The host's clock and the robot's differ, so the task also judges a period of which at least half is over.
        """
        if 2 * len(self._force) >= self.config.ticks:
            self._judge()
        return self.ended is not None

    def outcome(self) -> dict[str, Any]:
        """Return how the episode ended, or how it would if time were over now."""
        if self._force:
            self._judge()
        record, track = self.ended, self.sim.tracks[0]
        if record is None and not track.depths:
            return {"success": False, "category": "timeout"}
        if record is None:
            category, depth = track.at_time(self.config), track.depths[-1]
            return {"success": False, "category": category, "peak_force_n": track.peak, "depth_m": depth}
        ended = {"success": record["success"], "category": record["category"]}
        return {**ended, "peak_force_n": record["peak_force"], "depth_m": record["depth"]}


def serve(robot: SimulatedRobot, link: socket.socket, latency: float) -> None:
    """Run the robot in real time and answer requests until the other side disconnects.

    Args:
        robot: the robot.
        link: the connected socket.
        latency: delay of commands and of readings, s; pictures are not delayed.
    """
    period, rng = robot.config.control_period, stream(time.time_ns() % 2**31, "robot's clock")
    offset = float(rng.uniform(1e3, 1e6))  # a real robot's clock does not begin at 0 either
    # (time, reading), the oldest first; a client gets the oldest, which is `latency` old
    past: deque[tuple[float, dict[str, np.ndarray]]] = deque(maxlen=max(1, round(latency / period) + 1))
    commands: deque[tuple[float, np.ndarray]] = deque()  # (time at which it takes effect, pose of the flange)
    begun, connected = time.monotonic(), False
    while True:
        due = begun + (robot.ticks + 1) * period
        while (left := due - time.monotonic()) > 0 or not connected:
            if select.select([link], [], [], max(0.0, left) if connected else None)[0]:
                message, arrays = receive(link)
                if message["call"] == "connect":
                    start = robot.begin(int(message["seed"]))
                    begun, connected = time.monotonic(), True
                    past.clear()
                    commands.clear()
                    past.append((robot.time, robot.reading()))
                    file = robot.env.file
                    send(link, {"start": start, "world": {"name": file.name, "hash": file.hash} if file else {}})
                    due = begun + period
                elif message["call"] == "read":
                    at, values = past[0]
                    send(link, {"time": offset + at}, {**values, **robot.pictures(message["cameras"])})
                elif message["call"] == "ended":
                    send(link, {"ended": robot.over()})
                elif message["call"] == "command":
                    commands.append((robot.time + latency, arrays["pose"]))
                elif message["call"] == "stop":
                    commands.clear()
                    robot.rest()
                    send(link, robot.outcome())
        while commands and commands[0][0] <= robot.time + 1e-9:
            robot.hold(commands.popleft()[1])
        robot.tick()
        past.append((robot.time, robot.reading()))
        if (behind := time.monotonic() - due) > BEHIND:
            begun += behind


def main() -> int:
    """Read the robot's settings, a line of JSON; print the port or an error, likewise; serve one client."""
    request = json.loads(sys.stdin.readline())
    try:
        robot = SimulatedRobot(request["world"], request["obs_mode"], request["settings"])
    except UserError as error:
        print(json.dumps({"error": str(error)}), flush=True)
        return 2
    with socket.create_server(("127.0.0.1", 0), backlog=1) as server:
        print(json.dumps({"port": server.getsockname()[1]}), flush=True)
        link, _ = server.accept()
    with link:
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            message, _ = receive(link)
            if message.get("token") == request["token"]:
                serve(robot, link, float(request["latency"]))
        except (OSError, EOFError):
            pass
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
