"""Step a batch of simulations with MuJoCo Warp, on a GPU or the CPU, behind the calls of `mujoco.batch` that cells use.

The state of every row stays in the rows of a `mujoco.batch` on the host, and so do the model fields that differ between
rows and the constants that MuJoCo derives from them. A call sends them to the device, computes there, and stores the
results of its own rows. So rows are independent of each other's resets, and the controller and all effects work on the
same float64 arrays as with `mujoco.batch`.

MuJoCo Warp itself computes in float32. In free motion, joint angles differ from MuJoCo's by 1e-6 rad. Two bodies that
overlap by less than 10 um may count as apart in a step, so single steps of a contact that chatters differ, by 20 N at
most in the cell; the force of a lasting contact differs by less than 1 %.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from typing import Any

import mujoco
import numpy as np
import warp as wp
from mujoco import batch as mjb

from vispeg.core.errors import UserError
from vispeg.sim.physics import OVERLAP

wp.config.log_level = wp.LOG_WARNING  # before MuJoCo Warp is imported: standard output belongs to commands
import mujoco_warp as mjw  # noqa: E402  # see above

STATE = ("qpos", "qvel", "qacc_warmstart")
INPUTS = ("ctrl", "qfrc_applied", "xfrc_applied")
UNKNOWN = ("act", "history", "mocap_pos", "userdata", "plugin_state")  # parts of a state that are not transferred
CONTACTS = 64  # room for contacts and for pairs of geoms near each other, per row
GREATEST = 1e10  # MuJoCo's mjMAXVAL: a state beyond it is reset
FULL = int(  # what happened if a row had not enough room
    mjw.OverflowType.NEFC
    | mjw.OverflowType.NJMAX_NNZ
    | mjw.OverflowType.BROADPHASE
    | mjw.OverflowType.NARROWPHASE
    | mjw.OverflowType.CCD
)
PLACES = frozenset({"body_pos", "body_quat", "geom_pos", "geom_quat"})  # fields that place geoms
# Kept on the host: the limits of `WarpBatch.step`, and marks by which MuJoCo saves work that MuJoCo Warp always does
HOST = frozenset({"opt.iterations", "body_sameframe", "geom_sameframe", "site_sameframe"})


def _by_row(owner: Any, prefix: str = "") -> set[str]:
    """Return the names of a dataclass's arrays that can have a leading axis of rows."""
    shapes = {f.name: getattr(f.type, "shape", ()) for f in fields(owner)}
    return {prefix + name for name, shape in shapes.items() if shape and shape[0] == "*"}


BY_ROW = frozenset((_by_row(mjw.Model) | _by_row(mjw.Option, "opt.")) & mjb.MODEL_FIELDS)


def device() -> str:
    """Return the name of the device on which a WarpBatch computes."""
    return str(wp.get_device().name)


def foreign(names: Iterable[str]) -> list[str]:
    """Return those of the model fields that cannot differ between the rows of a WarpBatch."""
    return sorted(set(names) - BY_ROW - HOST)


class WarpBatch:
    """`nsim` simulations of a model on Warp's default device: the first GPU, or the CPU if there is none.

    The calls are those of `mujoco.batch.Batch`, with two differences. Every write to a model field begins with
    `expand`, which marks it to be sent to the device. And a row whose contacts do not find room on the device gets a
    warning like one with a diverged state, as its step is wrong.

    Args:
        model: the model of all rows.
        nsim: number of rows.
        nthread: threads of what runs on the host.

    Attributes:
        warning: as in `mujoco.batch.Batch`.

    Raises:
        UserError: a model with a feature that MuJoCo Warp lacks.
    """

    def __init__(self, model: mujoco.MjModel, nsim: int, nthread: int = 1):
        self.model, self.nsim = model, nsim
        self._host = mjb.Batch(model, nsim, nthread=nthread)
        lacking = [name for name in UNKNOWN if self._host.bind(name).size]
        if lacking:
            raise UserError("MuJoCo Warp steps no model with this state here", key="engine", got=lacking)
        dim = int(model.geom_condim.max(initial=1))
        rows_each = dim if model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC else max(1, 2 * (dim - 1))
        # friction and both limits of each dof, equalities, contacts
        room = {"nconmax": CONTACTS, "njmax": 3 * model.nv + model.neq * 6 + CONTACTS * rows_each}
        try:
            self._model, self._data = mjw.put_model(model), mjw.make_data(model, nworld=nsim, **room)
        except (NotImplementedError, ValueError) as error:
            raise UserError(f"MuJoCo Warp cannot step this model: {error}", key="engine") from error
        self._model.opt.warn_overflow = 0
        self._model.opt.ccd_tolerance.fill_(OVERLAP)  # at the default twice as many overlaps are missed
        self._model.opt.run_rne_postconstraint = True  # forces between bodies
        self.warning = np.zeros_like(self._host.warning)
        self._outputs: dict[str, np.ndarray] = {}
        self._unsent: set[str] = set()
        self._graphs: dict[tuple[str, int], Any] = {}
        self._shapes = mujoco.MjData(model)
        self._geoms = {name: self._host.bind(name) for name in ("geom_xpos", "geom_xmat")}

    def bind(self, name: str) -> np.ndarray:
        """Return a live array (nsim, ...) over a field of MjData: of the state, or an output of the last call."""
        if name in (*STATE, *INPUTS):
            return self._host.bind(name)
        if name not in self._outputs:
            shape = (self.nsim, *getattr(self._shapes, name).shape)
            self._outputs[name] = np.zeros(shape)
        return self._outputs[name]

    def expand(self, name: str) -> np.ndarray:
        """Return a model field's values by row (nsim, ...), to be written before the next call.

        Raises:
            UserError: MuJoCo Warp has one value of this field for all rows.
        """
        if foreign([name]):
            raise UserError("MuJoCo Warp has one value of this field for all rows", key="engine", got=name)
        if name in BY_ROW:
            self._unsent.add(name)
        return self._host.expand(name)

    def expanded(self, name: str) -> np.ndarray | None:
        """Return a model field's values by row, read-only, or None if all rows have the model's."""
        return self._host.expanded(name)

    def set_const(self, ids: np.ndarray | None = None) -> None:
        """Derive constants such as inverse weights from the model fields of rows (indices; None: all)."""
        self._host.set_const(ids)
        self._unsent |= {name for name in BY_ROW if self._host.expanded(name) is not None}

    def reset(self, ids: np.ndarray | None = None, stage: int = mujoco.mjtStage.mjSTAGE_ACC.value) -> None:
        """Reset rows (indices; None: all) to the model's defaults, then compute what follows from them."""
        self._host.reset(ids=ids, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        if stage != mujoco.mjtStage.mjSTAGE_NONE.value:
            self.forward(ids)

    def forward(self, ids: np.ndarray | None = None) -> None:
        """Compute what follows from the state of rows (indices; None: all)."""
        self._send()
        self._run("forward", int(self.model.opt.iterations))
        self._store(slice(None) if ids is None else np.asarray(ids), moved=False)

    def step(self, nstep: int = 1) -> None:
        """Advance all rows by `nstep` physics steps.

        MuJoCo Warp has one limit of solver iterations for all rows. A row that took more than its own `opt.iterations`
        therefore steps again from the same state, under its own limit.
        """
        limits, most = self._host.expanded("opt.iterations"), int(self.model.opt.iterations)
        if limits is None or (limits == most).all():
            self._send()
            for _ in range(nstep):
                self._run("step", most)
            self._store(slice(None))
            return
        most = max(most, int(limits.max()))
        for _ in range(nstep):
            self._send()
            self._run("step", most)
            late = self._data.solver_niter.numpy() > limits
            self._store(np.flatnonzero(~late) if late.any() else slice(None))
            for limit in np.unique(limits[late]):
                self._send()
                self._run("step", int(limit))
                self._store(np.flatnonzero(late & (limits == limit)))

    def _send(self) -> None:
        for name in self._unsent:
            owner = self._model.opt if name.startswith("opt.") else self._model
            place, values = name.removeprefix("opt."), self._host.expanded(name)
            array = getattr(owner, place)
            if array.shape[0] == self.nsim:
                array.assign(_as(array, values))
            else:  # one value for all rows until now
                setattr(owner, place, wp.array(_as(array, values), dtype=array.dtype))
                self._graphs.clear()
        if self._unsent & PLACES:  # MuJoCo Warp computes the poses of geoms that cannot move only once
            self._host.forward(stage=mujoco.mjtStage.mjSTAGE_POS.value)
            for name, values in self._geoms.items():
                getattr(self._data, name).assign(_as(getattr(self._data, name), values))
        self._unsent.clear()
        for name in (*STATE, *INPUTS):
            getattr(self._data, name).assign(_as(getattr(self._data, name), self._host.bind(name)))

    def _run(self, call: str, iterations: int) -> None:
        """Call `mjw.step` or `mjw.forward` with a limit of solver iterations; a GPU captures its second call."""
        self._model.opt.iterations, what = iterations, getattr(mjw, call)
        key = call, iterations
        if not self._data.qpos.device.is_cuda:
            what(self._model, self._data)
        elif key not in self._graphs:  # compiles the kernels, which a capture cannot
            what(self._model, self._data)
            self._graphs[key] = None
        else:
            if self._graphs[key] is None:
                with wp.ScopedCapture() as capture:
                    what(self._model, self._data)
                self._graphs[key] = capture.graph
            wp.capture_launch(self._graphs[key])

    def _store(self, rows: slice | np.ndarray, moved: bool = True) -> None:
        """Store the results of `rows`; reset those whose state diverged, as MuJoCo does."""
        for name, values in self._outputs.items():
            values[rows] = getattr(self._data, name).numpy().reshape(values.shape)[rows]
        if not moved:
            return
        for name in STATE:
            self._host.bind(name)[rows] = getattr(self._data, name).numpy()[rows]
        full = (self._data.overflow.numpy() & FULL) != 0
        self._data.overflow.zero_()
        asked = np.zeros(self.nsim, dtype=bool)
        asked[rows] = True
        state = np.concatenate([self._host.bind("qpos"), self._host.bind("qvel")], axis=1)
        wild = asked & ~(np.abs(state) < GREATEST).all(axis=1)  # NaN too
        self.warning[(wild | full) & asked, mujoco.mjtWarning.mjWARN_BADQPOS.value, 1] += 1
        if wild.any():
            self._host.reset(ids=np.flatnonzero(wild), stage=mujoco.mjtStage.mjSTAGE_NONE.value)


def _as(array: Any, values: np.ndarray) -> np.ndarray:
    """Return values (nsim, ...) of a field in the type and shape of Warp's array of it."""
    kind = wp.dtype_to_numpy(getattr(array.dtype, "_wp_scalar_type_", array.dtype))
    shape = (len(values), *array.shape[1:], *getattr(array.dtype, "_shape_", ()))
    return np.ascontiguousarray(values.reshape(shape), dtype=kind)
