"""What a diagnosis of contact names is felt by a policy: `model:` changes the cell that episodes are played in."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from vispeg.contact.selection.profile import looked_for
from vispeg.core.effect import EffectInstance
from vispeg.task.environments.simulation import TaskSimulation
from vispeg.task.peg.config import PegConfig
from vispeg.task.peg.task import PegTask
from vispeg.task.world_file import FORMAT, load_world
from vispeg.worlds.model_file import model_text
from vispeg.worlds.randomized import RandomizedEffect, RandomizedWorld
from vispeg.worlds.world import World

CONFIG = PegConfig(start_radius=0.0)
SCENE = PegTask().cell(CONFIG)
# of the tip from the hole's mouth, m, each held for as many steps: into the hole, against its wall, out, onto the rim,
# along it
WAY = (
    ((0, 0, 0.004), 14), ((0, 0, -0.008), 8), ((0.012, 0.008, -0.008), 6), ((0, 0, -0.006), 3), ((0, 0, 0.008), 6),
    ((0.03, 0, 0.006), 8), ((0.03, 0, -0.02), 8), ((0.03, 0.04, -0.02), 8),
)  # fmt: skip


def instances():
    """Every parameter of every effect that a diagnosis of contact chooses from, at the size furthest from absence."""
    for kind in looked_for():
        targets = kind.targets(SCENE)
        where = SCENE.held if SCENE.held in targets else targets[0]
        for name, sizes in kind.sizes.items():
            p = kind.params[name]
            far = max(sizes, key=lambda v, p=p: abs(np.log(v / p.null)) if p.scale == "log" else abs(v - p.null))
            yield EffectInstance.of(kind.name, where, **{name: far})


PLACED = list(instances())


class Listed(RandomizedWorld):
    """A randomized world that draws these one after the other, whatever the seed."""

    def __init__(self, worlds):
        super().__init__()
        object.__setattr__(self, "worlds", iter(worlds))

    def sample(self, seed, scene, levels):
        return next(self.worlds).sample(seed, scene, levels)


def of_model(placed, folder):
    """The world whose `model:` is a file with this effect alone."""
    name = f"{placed.effect}-{'-'.join(k for k, v in placed.params.items() if v.value)}"
    (folder / f"{name}-model.yaml").write_text(model_text(World("iiwa14", "meg50+peg16", (placed,))))
    world = {"format": FORMAT, "name": name, "base": "nominal", "model": {"file": f"{name}-model.yaml", "widen": 0}}
    (folder / f"{name}.yaml").write_text(yaml.safe_dump(world))
    return load_world(folder / f"{name}.yaml").world


@pytest.fixture(scope="module")
def felt(tmp_path_factory):
    """(nworld, steps, 9): the flange's place (m) and the wrench (N, N m) as they are read, the nominal cell first."""
    folder = tmp_path_factory.mktemp("models")
    worlds = [RandomizedWorld(), *(of_model(p, folder) for p in PLACED)]
    every = {p.label: RandomizedEffect(p.effect, p.where, {}) for p in PLACED}
    sim = TaskSimulation(RandomizedWorld(tuple(every.values())), CONFIG, len(worlds))
    sim.world = Listed(worlds)
    sim.reset(np.arange(len(worlds)), [0] * len(worlds))
    out = []
    for place, steps in WAY:
        for _ in range(steps):
            tip = sim.seen.flange - [0.0, 0.0, SCENE.tip] - SCENE.target
            sim.step(np.clip((np.array(place) - tip) / CONFIG.offset, -1, 1))
            out.append(np.concatenate([sim.seen.flange, sim.seen.wrench], axis=1))
    return np.stack(out, axis=1)


@pytest.mark.slow
def test_the_way_touches_wall_and_rim(felt):
    force = np.linalg.norm(felt[0, :, 3:6], axis=1)
    assert np.abs(felt[0, 22:28, 3:5]).max() > 2.0 and force[-16:].max() > 8.0 and force[:20].max() < 1.0


@pytest.mark.parametrize("row", range(len(PLACED)), ids=lambda k: f"{PLACED[k].label}-{k}")
def test_what_a_model_names_changes_the_cell_that_is_played_in(row, felt):
    """Rows whose cells are the same are so bit for bit (a gain of the sensor moves no arm); others are told apart."""
    off = np.abs(felt[row + 1] - felt[0])
    assert np.isfinite(off).all()
    assert off[:, :3].max() > 1e-6 or off[:, 3:].max() > 0.01
    if PLACED[row].effect in ("wrench_gain", "wrench_bias", "wrench_delay"):
        assert off[:, :3].max() == 0.0
