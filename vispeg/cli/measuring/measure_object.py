"""`vispeg measure mass | com | friction | restitution | stiffness`: readings in a table or recordings, to a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import tyro

from vispeg.cli.measuring.measure_stop import Asked, Stop
from vispeg.cli.output import Output, OutputOptions

if TYPE_CHECKING:
    import numpy as np

    from vispeg.core.effect import EffectInstance
    from vispeg.measure.outcome import Outcome
    from vispeg.measure.readings import Readings
    from vispeg.worlds.measurement_file import Quantity


@dataclass(frozen=True, kw_only=True)
class _Common:
    """What all of them take."""

    out: Path
    """The measurement file to write (.yaml)."""
    resolution: tuple[str, ...] = ()
    """One digit of the instrument for each column read, such as angle_deg=0.1 mass_g=1."""
    accuracy: tuple[str, ...] = ()
    """Limit of the instrument's error a column, such as mass_g=2; none where not given."""
    conditions: tuple[str, ...] = ()
    """Conditions to note in the file, such as surface=steel temperature=21."""
    seed: int = 0
    """Seed of the Monte Carlo propagation."""
    overwrite: bool = False
    """Replace OUT if it is there."""
    stop: Asked = Stop()
    output: OutputOptions = Output()

    protocol: ClassVar[str]

    def run(self) -> int:
        """Measures, writes OUT, prints the number and what it becomes."""
        from vispeg.api.playing import check_numbers
        from vispeg.cli.measuring.measure_write import check_out, conditions, tell, write
        from vispeg.core.errors import UserError
        from vispeg.core.seeds import stream
        from vispeg.worlds.measurement_file import Measurement

        check_out(self.out, self.overwrite)
        check_numbers(self.stop.episodes, self.stop.workers)
        stated = conditions(self.conditions)
        outcome = self._measure(stream(self.seed, "measure", self.protocol))
        notes = list(outcome.notes)
        try:
            effects = self._effects(outcome.results)
        except UserError as error:
            effects, notes = [], [*notes, f"it has no effect in a model: {error}"]
        measurement = Measurement(
            self.protocol,
            self._of(),
            outcome.results,
            tuple(effects),
            conditions=stated,
            notes=tuple(notes),
            details=outcome.details,
        )
        full = write(measurement, self.out, self._inputs(), self.seed, self.overwrite)
        tell(full, self.out, self.stop, self.output, str(self.out))
        return 0

    def _of(self) -> str:
        raise NotImplementedError

    def _inputs(self) -> Sequence[Path]:
        raise NotImplementedError

    def _measure(self, rng: np.random.Generator) -> Outcome:
        raise NotImplementedError

    def _effects(self, results: Sequence[Quantity]) -> list[EffectInstance]:
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class _FromTable(_Common):
    """Readings in one table."""

    readings: tyro.conf.Positional[Path]
    """Table of readings (.csv, .csv.gz, .parquet); a unit may end a column's name: angle_deg, mass_g, h1_mm, t_ms."""

    def _inputs(self) -> Sequence[Path]:
        return (self.readings,)

    def _table(self) -> Readings:
        from vispeg.measure.readings import read

        return read(self.readings, self.resolution, self.accuracy)


@dataclass(frozen=True, kw_only=True)
class Mass(_FromTable):
    """Weighs: columns mass and, where the empty scale was read before each, tare (kg; or mass_g, tare_g).

    Example: vispeg measure mass tool.csv --resolution mass_g=1 --out mass.yaml
    """

    where: str = "flange"
    """What was weighed: a thing at the `flange` (becomes payload), or the part that the gripper holds (object_mass)."""
    nominal: float | None = None
    """Mass of the part in the model, kg; that of the world's cell where not given."""
    protocol: ClassVar[str] = "mass"

    def _of(self) -> str:
        return self.where

    def _measure(self, rng: np.random.Generator) -> Outcome:
        from vispeg.measure.mass import measure

        return measure(self._table(), rng)

    def _effects(self, results: Sequence[Quantity]) -> list[EffectInstance]:
        from vispeg.cli.measuring.measure_nominal import cell_value
        from vispeg.measure.becomes import payload, scaled

        if self.where == "flange":
            return [payload(results, None)]
        nominal = self.nominal or cell_value("mass", self.where, self.stop.world)
        return [scaled(results[0], self.where, nominal)]


@dataclass(frozen=True, kw_only=True)
class Com(_Common):
    """Finds the centre of mass: of a thing at the flange from wrenches at rest, or on a photograph from plumb lines.

    A table has columns fx fy fz tx ty tz and gravity's direction gx gy gz in the same frame, four attitudes or more; or
    x, y and angle of two plumb lines or more. Recordings hold still in four attitudes or more and have `ft`.

    Example: vispeg measure com attitude-a attitude-b attitude-c attitude-d --out com.yaml
    """

    readings: tyro.conf.Positional[tuple[Path, ...]]
    """One table, or recordings."""
    mass: Path | None = None
    """Measurement file of the mass, for plumb lines."""
    axes: tuple[str, str] = ("x", "y")
    """The flange's axes that the photograph's x and y are, for plumb lines."""
    protocol: ClassVar[str] = "com"

    def _of(self) -> str:
        return "flange"

    def _inputs(self) -> Sequence[Path]:
        return self.readings if self.mass is None else (*self.readings, self.mass)

    def _measure(self, rng: np.random.Generator) -> Outcome:
        from vispeg.measure.com import attitudes, measure
        from vispeg.measure.from_recordings import at_rest
        from vispeg.measure.readings import read

        if len(self.readings) == 1 and not self.readings[0].is_dir():
            return measure(read(self.readings[0], self.resolution, self.accuracy), rng)
        wrench, down = at_rest(self.readings)
        return attitudes(wrench, down, rng, ", ".join(map(str, self.readings)))

    def _effects(self, results: Sequence[Quantity]) -> list[EffectInstance]:
        from vispeg.core.errors import UserError
        from vispeg.measure.becomes import payload
        from vispeg.worlds.measurement_file import load_measurement

        if not set(self.axes) <= set("xyz") or len(set(self.axes)) < 2:
            raise UserError("not two axes", key="--axes", expected="two of x y z", got=" ".join(self.axes))
        mass = None if self.mass is None else load_measurement(self.mass).result("mass")
        flat = all(q.quantity != "mass" for q in results)
        return [payload(results, mass, self.axes if flat else "xyz")]


@dataclass(frozen=True, kw_only=True)
class Friction(_Common):
    """Finds a coefficient of friction: on an incline, timed down an incline, or from forces while sliding.

    Columns: angle (rad, or angle_deg) at which it lets go; with distance and time also how it slid; or normal and
    tangential (N); and place (a number) of three places or more. Recordings have `ft`, begin in free air, and slide.

    Example: vispeg measure friction slides.csv --resolution angle_deg=0.1 --out friction.yaml
    """

    readings: tyro.conf.Positional[tuple[Path, ...]]
    """One table, or recordings."""
    where: str | None = None
    """The part, such as fixture, gripper or table; what the gripper holds where not given."""
    nominal: float | None = None
    """Coefficient of the part in the model; that of the world's cell where not given."""
    protocol: ClassVar[str] = "friction"

    def _of(self) -> str:
        from vispeg.cli.measuring.measure_nominal import held

        return self.where or held(self.stop.world)

    def _inputs(self) -> Sequence[Path]:
        return self.readings

    def _measure(self, rng: np.random.Generator) -> Outcome:
        from vispeg.measure.friction import measure
        from vispeg.measure.from_recordings import slides
        from vispeg.measure.readings import read

        if len(self.readings) == 1 and not self.readings[0].is_dir():
            return measure(read(self.readings[0], self.resolution, self.accuracy), rng)
        return measure(slides(self.readings), rng)

    def _effects(self, results: Sequence[Quantity]) -> list[EffectInstance]:
        from vispeg.cli.measuring.measure_nominal import cell_value
        from vispeg.measure.becomes import scaled

        nominal = self.nominal or cell_value("friction", self._of(), self.stop.world)
        return [scaled(results[0], self._of(), nominal)]


@dataclass(frozen=True, kw_only=True)
class Restitution(_FromTable):
    """Finds the coefficient of restitution: columns t1 t2 t3 (s) of three touches, flight1 flight2, or drop bounce (m).

    Example: vispeg measure restitution bounces.csv --resolution t1=0.001 t2=0.001 t3=0.001 --out e.yaml
    """

    where: str | None = None
    """The part, such as fixture, gripper or table; what the gripper holds where not given."""
    protocol: ClassVar[str] = "restitution"

    def _of(self) -> str:
        from vispeg.cli.measuring.measure_nominal import held

        return self.where or held(self.stop.world)

    def _measure(self, rng: np.random.Generator) -> Outcome:
        from vispeg.measure.restitution import measure

        return measure(self._table(), rng)

    def _effects(self, results: Sequence[Quantity]) -> list[EffectInstance]:
        from vispeg.core.effect import Value
        from vispeg.measure.becomes import placed

        q = results[0]
        return [placed("restitution", self._of(), {"e": Value(q.value, q.low, q.high)}, q)]


@dataclass(frozen=True, kw_only=True)
class Stiffness(_Common):
    """Finds the stiffness of a fixture: presses on a rigid stop and on the fixture, in two arm poses or more.

    A table has columns force (N), depth (m), on (0 stop, 1 fixture), and pose and ramp (numbers). Recordings have `ft`,
    begin in free air, and press along the flange's z; the n-th of --stop and of --fixture are of one arm pose.

    Example: vispeg measure stiffness presses.csv --resolution force=0.1 depth=1e-5 --out stiffness.yaml
    """

    readings: tyro.conf.Positional[Path | None] = None
    """Table of presses."""
    stop: tuple[Path, ...] = ()
    """Recordings of presses on a rigid stop."""
    fixture: tuple[Path, ...] = ()
    """Recordings of presses on the fixture."""
    where: str = "fixture"
    """The part, such as fixture, gripper or table."""
    nominal: float | None = None
    """Stiffness of the contact in the model, N/m; without it the measurement becomes no effect."""
    protocol: ClassVar[str] = "stiffness"

    def _of(self) -> str:
        return self.where

    def _inputs(self) -> Sequence[Path]:
        return [*([] if self.readings is None else [self.readings]), *self.stop, *self.fixture]

    def _measure(self, rng: np.random.Generator) -> Outcome:
        from vispeg.core.errors import UserError
        from vispeg.measure.from_recordings import presses
        from vispeg.measure.readings import read
        from vispeg.measure.stiffness import measure

        if (self.readings is None) == (not self.stop and not self.fixture):
            raise UserError("nothing to read, or twice", expected="a table, or --stop and --fixture")
        if self.readings is not None:
            return measure(read(self.readings, self.resolution, self.accuracy), rng)
        return measure(presses(self.stop, self.fixture), rng)

    def _effects(self, results: Sequence[Quantity]) -> list[EffectInstance]:
        from vispeg.core.errors import UserError
        from vispeg.measure.becomes import scaled

        if self.nominal is None:
            raise UserError("the model's own stiffness is not stated", key="--nominal", expected="N/m")
        return [scaled(results[0], self.where, self.nominal)]
