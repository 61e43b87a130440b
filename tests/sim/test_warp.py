"""MuJoCo Warp steps the cell as MuJoCo does, here on the CPU: each effect, contact, rows of their own, whole episodes.

Its kernels are compiled at their first use on a machine, which takes one to two minutes.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from vispeg.core.effect import REGISTRY, EffectInstance
from vispeg.core.errors import UserError
from vispeg.learn.evaluation import run_episodes
from vispeg.learn.policy import load
from vispeg.robots.scene import build
from vispeg.sim.compiled import compiled
from vispeg.sim.engine import ENGINES
from vispeg.task.environments.vector import TaskVec
from vispeg.task.start import Start
from vispeg.worlds.world import World

pytest.importorskip("mujoco_warp")
SCENE = build()
POLICY = Path(__file__).parents[2] / "assets" / "policies" / "state-3mm-randomized"
PHYSICAL = [kind for _, kind in REGISTRY.items() if kind.targets(SCENE) and kind.family not in ("camera", "appearance")]
NOISY = {"encoder_quantization"}  # a reading next to a step's edge differs by the whole step
slow = [pytest.mark.slow, pytest.mark.timeout(1800)]


def both(rows: int, world: World | str = "nominal") -> list[TaskVec]:
    """The same environments on each engine."""
    return [TaskVec(rows, world, engine=engine, autoreset_mode="Disabled", privileged=True) for engine in ENGINES]


def test_another_engine_is_refused():
    with pytest.raises(UserError, match="no such engine; got 'cuda'; choices: c, warp"):
        TaskVec(1, "nominal", engine="cuda")


def test_it_is_imported_only_where_it_is_asked_for():
    code = "import sys, vispeg; vispeg.make('nominal'); print([m for m in ('warp', 'mujoco_warp') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_it_has_the_effects_of_cells_and_refuses_a_field_that_all_rows_share():
    from vispeg.sim.warp import WarpBatch, foreign

    assert not [kind.name for kind in PHYSICAL if foreign(kind.writes)]
    with pytest.raises(UserError, match="one value of this field for all rows; got 'opt.impratio'"):
        WarpBatch(compiled(SCENE), 2).expand("opt.impratio")


class TestAgreement:
    pytestmark = slow

    def test_every_effect_acts_alike_in_free_motion(self):
        """A row for each effect at a typical size, at the middle one of the places where it can be."""
        kinds = [kind for kind in PHYSICAL if kind.name not in NOISY]
        values = [{name: p.start for name, p in kind.params.items()} for kind in kinds]
        starts = [
            Start(effects=(EffectInstance.of(kind.name, (places := kind.targets(SCENE))[len(places) // 2], **each),))
            for kind, each in zip(kinds, values, strict=True)
        ]
        ends = []
        for env in both(len(kinds)):
            env.reset(seed=[7] * len(kinds), options={"start": starts})
            for k in range(3):
                env.step(np.tile([0.5, -0.5, 0.3 * k], (len(kinds), 1)))
            ends.append(env.sim.cell.qpos[:, env.sim.cell.qposes].copy())
        apart = np.abs(ends[0] - ends[1]).max(axis=1)
        assert apart.max() < 5e-6, {kind.name: float(a) for kind, a in zip(kinds, apart, strict=True) if a >= 5e-6}

    def test_a_part_that_is_pressed_down_transmits_the_same_force(self):
        """The peg stands on the fixture beside the hole and comes to rest there."""
        ends, peaks = [], []
        for env in both(2):
            env.reset(seed=[3, 4], options={"start": Start(goal=np.array(env.sim.nominal_goal) + [0.03, 0, 0])})
            for _ in range(25):
                env.step(np.tile([0.0, 0.0, -1.0], (2, 1)))
            cell = env.sim.cell
            ends.append((cell.qpos.copy(), np.linalg.norm(cell.sensors[:, 7:10], axis=1)))
            peaks.append([max(map(np.max, track.forces)) for track in env.sim.tracks])
        assert ends[0][1].min() > 10
        assert ends[1][1] == pytest.approx(ends[0][1], rel=0.01)
        assert np.abs(ends[1][0] - ends[0][0]).max() < 1e-4
        assert peaks[1] == pytest.approx(peaks[0], rel=0.2)

    @pytest.mark.parametrize("world", ["nominal", "randomized"])
    def test_the_same_episodes_succeed(self, world):
        policy, seeds = load(POLICY), range(1000, 1016)
        c, warp = ([e.info for e in run_episodes(policy, env, seeds)] for env in both(16, world))
        assert [e["success"] for e in c] == [e["success"] for e in warp]
        assert sum(e["success"] for e in c) >= 15
        late = np.abs([ours["time"] - theirs["time"] for ours, theirs in zip(c, warp, strict=True)])
        assert np.median(late) == 0 and late.max() < 1.0
        peaks = np.array([[e["peak_force"] for e in played] for played in (c, warp)])
        assert np.median(np.abs(peaks[1] / peaks[0] - 1)) < 0.05, peaks  # chattering contact decides the others
        assert peaks[1].mean() == pytest.approx(peaks[0].mean(), rel=0.1)


class TestRows:
    pytestmark = slow

    def played(self, env: TaskVec, steps: int) -> np.ndarray:
        """The state after each policy step downwards, (steps, rows, nq + nv)."""
        seen = []
        for _ in range(steps):
            env.step(np.tile([0.0, 0.0, -0.8], (env.num_envs, 1)))
            seen.append(np.concatenate([env.sim.cell.qpos, env.sim.cell.qvel], axis=1))
        return np.array(seen)

    def test_a_row_begins_anew_beside_others(self):
        """Bit for bit: its new episode is that of a fresh environment, and the others do not see it."""
        envs = [TaskVec(3, "randomized", engine="warp", autoreset_mode="Disabled") for _ in range(3)]
        for env, seeds in zip(envs, ([1, 2, 3], [1, 2, 3], [1, 9, 3]), strict=True):
            env.reset(seed=seeds)
        self.played(envs[0], 4), self.played(envs[1], 4)
        envs[0].reset(seed=[1, 9, 3], options={"reset_mask": [False, True, False]})
        reset, without, fresh = (self.played(env, 6) for env in envs)
        assert (reset[:, 1] == fresh[:, 1]).all()
        assert (reset[:, [0, 2]] == without[:, [0, 2]]).all()

    def test_a_row_has_its_own_limit_of_solver_iterations(self):
        """As if all rows had it, bit for bit."""
        from vispeg.sim.warp import WarpBatch

        model = mujoco.MjModel.from_xml_string(PILE)
        ends = []
        for limits in ([1, 1, 1], [1, 2, 100], [100, 100, 100]):
            batch = WarpBatch(model, 3)
            batch.expand("opt.iterations")[:] = limits
            batch.bind("qvel")[:, 0] = 1.0
            batch.step(nstep=60)
            ends.append(batch.bind("qpos").copy())
        assert (ends[1][0] == ends[0][0]).all() and (ends[1][2] == ends[2][2]).all()
        assert np.abs(ends[1][0] - ends[1][2]).max() > 1e-6

    def test_a_row_that_diverges_is_reset_and_counted(self):
        from vispeg.sim.warp import WarpBatch

        batch = WarpBatch(mujoco.MjModel.from_xml_string(PILE), 3)
        batch.bind("qvel")[1] = 1e12
        batch.step()
        assert batch.warning[:, :, 1].sum(axis=1).tolist() == [0, 1, 0]
        assert (batch.bind("qpos")[1] == batch.model.qpos0).all()


PILE = """<mujoco><option timestep="0.002" cone="elliptic"/><worldbody><geom type="plane" size="1 1 .1"/>
<body pos="0 0 .05"><freejoint/><geom type="box" size=".05 .05 .05"/></body>
<body pos="0.01 0 .149"><freejoint/><geom type="box" size=".05 .05 .05"/></body></worldbody></mujoco>"""
