"""A base for channels of one measured signal with a column per joint, predicted by rollouts under the known controller.

Motor current and temperature are such signals. A plug-in defines one by a subclass with `name`, `shows` and `predict`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np

from vispeg.channels.channel import CHANNELS, Both, Channel, How
from vispeg.channels.joints import Joints
from vispeg.core.effect import Effect
from vispeg.core.errors import UserError
from vispeg.identify.channels import Channel as Column
from vispeg.identify.channels import Item
from vispeg.identify.evidence import Evidence
from vispeg.recordings.noise import highpass_sigma
from vispeg.recordings.recording import Recording
from vispeg.robots.objects import is_object
from vispeg.sim.rollout import Response
from vispeg.worlds.world import World


class SignalChannel(Channel):
    """A signal that a recording's header declares under `signals`, by the channel's own `name`.

    A subclass says how a rollout predicts it. Its effects are searched by the general search (`selection.plain`).
    """

    order = 15  # after the joints, whose effects change the rollouts

    @abstractmethod
    def predict(self, response: Response, item: Item, worlds: Sequence[World]) -> np.ndarray:
        """Predict the signal (nworld, m, nj), in the recording's unit.

        Args:
            response: the worlds' rollouts: angles, speeds and torques at the m samples that are compared.
            item: the stretch of a recording that they are compared with.
            worlds: the worlds that were rolled out; their effects may change the signal itself.
        """

    def has(self, world: World, recordings: Sequence[Recording]) -> bool:
        """Say whether there are recordings of an arm, all with the signal and a known controller."""
        known = all(self.name in rec.signals and rec.control.mode != "unknown" for rec in recordings)
        return known and bool(recordings) and not is_object(world.robot)

    def part(self, world: World) -> World:
        """Return the same part of the model as the joints do."""
        return CHANNELS[Joints.name].part(world)

    def read(self, recording: Recording, world: World, how: How) -> Recording:
        """Return a recording's most informative windows, with the load that the model's cell says the arm carried."""
        return CHANNELS[Joints.name].read(recording, world, how)

    def evidence(self, world: World, both: Both, how: How) -> tuple[Evidence, Evidence | None]:
        """Return rollouts that are compared by this signal alone."""
        first, second = ([self.read(rec, world, how) for rec in recordings] for recordings in both)
        judged = SignalEvidence(second, self, how.threads) if second else None
        return SignalEvidence(first, self, how.threads), judged


class SignalEvidence(Evidence):
    """Rollouts compared by the signal of `channel`; the other arguments are those of `Evidence`."""

    def __init__(self, recordings: Sequence[Recording], channel: SignalChannel, nthread: int):
        self.channel = channel
        super().__init__(recordings, nthread=nthread)
        stated = all(rec.signals[channel.name].noise is not None for rec in recordings)
        self.floor_from = "stated noise" if stated else "estimated"

    def sees(self, kind: Effect) -> bool:
        """Return whether the channel shows an effect."""
        return self.channel.shows(kind)

    def compared(
        self, rec: Recording, rows: np.ndarray, late: np.ndarray, noise: Mapping[str, np.ndarray]
    ) -> tuple[Column, ...]:
        """Return the signal's columns, with the noise that the header states, else an estimate from high frequencies.

        Arguments are as in `Evidence.compared`.

        Raises:
            UserError: no noise is stated, and that of a joint cannot be estimated.
        """
        signal = rec.signals[self.channel.name]
        values = signal.values[rows]
        sigma = highpass_sigma(signal.values) if signal.noise is None else np.full(values.shape[1], signal.noise)
        if not (sigma > 0).all():
            j = int(np.argmin(sigma))
            joint, estimable = rec.joints[j], np.isfinite(np.diff(signal.values[:, j], 4)).any()
            why = "does not vary" if estimable else "is never read five times in a row"
            what = f"{why}, so that its noise cannot be told"
            expected = f"signals.{self.channel.name}.noise"
            raise UserError(what, file=rec.path, key=f"{self.channel.name}.{joint}", expected=expected)
        return (Column(self.channel.name, values, sigma, np.isfinite(values) & late, signal.unit),)

    def predicted(self, channel: Column, item: Item, response: Response, worlds: Sequence[World]) -> np.ndarray:
        """Return the channel's prediction.

        Raises:
            UserError: it has the wrong shape.
        """
        values, shape = self.channel.predict(response, item, worlds), response.q.shape
        if np.shape(values) != shape:
            expected = f"(nworld, m, nj) = {shape}"
            what = f"channel '{self.channel.name}': `predict` returned an array of the wrong shape"
            raise UserError(what, expected=expected, got=np.shape(values))
        return values
