"""Record the episodes of an environment as trials."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.interface.builder import Picture
from vispeg.interface.terms import POLICY
from vispeg.render.image_kinds import DEPTH, camera_of, kind_of
from vispeg.task.environments.vector import TaskVec
from vispeg.task.interface import interface_of
from vispeg.trials.tape import Tape
from vispeg.trials.trial import OutcomePart, PolicyPart, Said, StartPart, TimingPart, Trial, WorldPart, write_trial
from vispeg.worlds.model_file import without_origin


class Kept:
    """An environment whose episodes are written to folders.

    Args:
        env: the environment to step: `vec` or a wrapper of it.
        vec: the underlying environment, with autoreset disabled.
        who: the policy.
        folder: folder of the trials.
        stem: prefix of their names, before the seed.
        seeds: seeds of the episodes to record.
        world, world_hash: name and hash of the world, written to each trial.
    """

    def __init__(
        self,
        env: Any,
        vec: TaskVec,
        who: PolicyPart,
        folder: Path,
        stem: str,
        seeds: Collection[int],
        world: str,
        world_hash: str,
    ):
        self.env, self.vec, self.who, self.folder, self.stem, self.seeds = env, vec, who, folder, stem, set(seeds)
        self.world, self.num_envs, self.config = WorldPart(name=world, hash=world_hash), vec.num_envs, vec.config
        self.images = [key for key in vec.keys if kind_of(key) is not None]
        origin = {"modality": who.modality, "world": world, "world_hash": world_hash, "policy": who.digest}
        sim = vec.sim
        self.interface = interface_of(vec.config, sim.scene, vec.obs_mode, vec.cameras, self.images, **origin)
        # by row: wrench of the last tick, (6,) N and N m in flange axes, and control periods since the reset
        self._felt, self._ticks = np.zeros((self.num_envs, 6)), np.zeros(self.num_envs, int)
        self._tapes: dict[int, Tape] = {}
        self._starts: dict[int, StartPart] = {}

    def reset(self, *, seed: Any = None, options: Mapping[str, Any] | None = None) -> Any:
        """Reset the environment, and start recording the reset rows whose seed is to be recorded."""
        result = self.env.reset(seed=seed, options=options)
        self._seen, sim = result[0], self.vec.sim
        rows = np.flatnonzero((options or {}).get("reset_mask", np.ones(self.num_envs, dtype=bool)))
        goal = sim.cell.site_position("goal")
        turn = sim.seen.chain.rotation(sim.seen.measured[0])
        for row in rows.tolist():
            self._ticks[row], self._felt[row] = 0, 0.0
            self._felt[row, :3] = turn[row].T @ sim.seen.weight  # the tool's weight, until a tick has measured
            self._tapes.pop(row, None)
            if int(sim.seeds[row]) in self.seeds:
                self._tapes[row] = Tape(self.interface)
                self._starts[row] = StartPart(
                    q_rad=sim.seen.measured[0][row].tolist(),
                    goal_m=goal[row].tolist(),
                    believed_m=sim.seen.believed[row].tolist(),
                    effects=[dict(without_origin(e)) for e in self.vec.drawn(row).effects],
                )
        return result

    def step(self, actions: np.ndarray) -> Any:
        """Step the environment, and write recorded episodes that end."""
        sim, acting = self.vec.sim, True  # the policy acts in the step's first control period

        def heard(q: np.ndarray, dq: np.ndarray, felt: np.ndarray) -> None:
            """Record a control period: `felt` comes at its end, so q and dq are recorded with the wrench before."""
            nonlocal acting
            for row, tape in self._tapes.items():
                target = np.concatenate([sim.seen.goal[row], sim.seen.rot[row]])
                time = self._ticks[row] * self.config.control_period
                tape.tick(time, q[row], dq[row], self._felt[row], target)
                if acting:
                    seen, action = self._seen[POLICY][row], sim.seen.action[row]
                    tape.step(0.0, seen, action, target, self._pictures(row))  # 0 s late
            acting = False
            self._ticks += 1
            self._felt = felt.copy()

        sim.heard = heard
        try:
            result = self.env.step(actions)
        finally:
            sim.heard = None
        self._seen, _, terminated, truncated, infos = result
        for row in np.flatnonzero(terminated | truncated).tolist():
            if row in self._tapes:
                self._write(row, infos["record"][row])
        return result

    def _pictures(self, row: int) -> dict[str, Picture]:
        out: dict[str, dict[str, np.ndarray]] = {}
        for key in self.images:
            image = self._seen[key][row]
            deep = kind_of(key) is DEPTH
            out.setdefault(camera_of(key), {})["depth" if deep else "rgb"] = (
                image[0] if deep else np.moveaxis(image, 0, -1)
            )
        return {name: Picture(images.get("rgb"), images.get("depth")) for name, images in out.items()}

    def _write(self, row: int, record: Mapping[str, Any]) -> None:
        tape, config, seed = self._tapes.pop(row), self.config, int(record["seed"])
        outcome = OutcomePart(
            success=bool(record["success"]),
            category=str(record["category"]),
            by="simulator",
            time_s=float(record["time"]),
            peak_force_n=float(record["peak_force"]),
            depth_m=float(record["depth"]),
        )
        steps, period = len(tape.late), config.policy_period
        said = Said(
            policy=self.who,
            robot="simulator",
            task=config.name,
            seed=seed,
            world=self.world,
            start=self._starts[row],
            outcome=outcome,
            timing=TimingPart(period_s=period, steps=steps, clipped=round(float(record["clipped"]) * steps)),
        )
        trial = Trial(said, tape.recording(notes="simulated"), tape.steps())
        write_trial(trial, self.folder / f"{self.stem}-{seed}", overwrite=True)
