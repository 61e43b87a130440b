"""The walk from a world's name to a picture goes down the floors: what is called up on the way stays countable."""

import sys
import tomllib
from pathlib import Path

import vispeg.task.environments.vector as vector

ROOT = Path(__file__).parents[2]
LAYERS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"][0]["layers"]
FLOOR = {room.strip(): -number for number, layer in enumerate(LAYERS) for room in layer.split("|")}
CLIMBS = 3  # calls of a function on a higher floor than its caller's; reading a mapping that was handed down is none


def floor(module):
    return FLOOR.get(".".join(module.split(".")[:2]))


def climbs(walk):
    """Distinct (caller's room, callee's module, function) of the calls that go up, and the modules passed through."""
    up, through = set(), set()

    def watch(frame, event, _):
        module = frame.f_globals.get("__name__", "")
        if event != "call" or floor(module) is None or frame.f_code.co_name == "<module>":
            return
        through.add(module)
        caller = frame.f_back
        while caller is not None and floor(caller.f_globals.get("__name__", "")) is None:
            caller = caller.f_back
        if caller is None or frame.f_code.co_name == "__getitem__":
            return
        room = ".".join(caller.f_globals["__name__"].split(".")[:2])
        if FLOOR[room] < floor(module):
            up.add((room, module, frame.f_code.co_name))

    sys.setprofile(watch)
    try:
        walk()
    finally:
        sys.setprofile(None)
    return up, through


def test_from_a_worlds_name_to_a_picture_the_calls_climb_at_most_three_times():
    def walk():
        env = vector.TaskVec(1, "S", obs_mode="rgbd")
        seen, _ = env.reset(seed=0)
        assert any(value.dtype == "uint8" for value in seen.values())
        env.close()

    up, through = climbs(walk)
    assert {"vispeg.task.world_file", "vispeg.worlds.world", "vispeg.render.cameras.pipeline"} <= through
    assert len(up) <= CLIMBS, sorted(up)


def test_a_climb_would_be_noticed():
    from vispeg.worlds.randomized import RandomizedWorld

    probe = {"__name__": "vispeg.core.probe", "called": RandomizedWorld.of}
    exec("def call(x):\n    return called(x)", probe)
    up, _ = climbs(lambda: probe["call"](vector.world_of("nominal", {})[0]))
    assert ("vispeg.core", "vispeg.worlds.randomized", "of") in up
