"""`vispeg measure mass | com | friction | restitution | stiffness`: readings in a table or recordings, to a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.cli.measuring.measuring import Measuring


@dataclass(frozen=True, kw_only=True)
class _Quantity(Measuring):
    """Readings of an instrument."""

    resolution: tuple[str, ...] = ()
    """One digit of the instrument for each column read, such as angle_deg=0.1 mass_g=1."""
    accuracy: tuple[str, ...] = ()
    """Limit of the instrument's error for each column, such as mass_g=2; default: none."""


@dataclass(frozen=True, kw_only=True)
class _FromTable(_Quantity):
    """Readings in one table."""

    readings: tyro.conf.Positional[Path]
    """Table of readings (.csv, .csv.gz, .parquet); a unit may end a column's name: angle_deg, mass_g, h1_mm, t_ms."""


@dataclass(frozen=True, kw_only=True)
class Mass(_FromTable):
    """Measures a mass by a scale.

    Columns: mass and, if the empty scale was read before each, tare (kg; or mass_g, tare_g).

    Example:
        vispeg measure mass tool.csv --resolution mass_g=1 --out mass.yaml
    """

    where: str = "flange"
    """What was weighed: a thing at the `flange` (payload), or the part in the gripper (object_mass)."""
    nominal: float | None = None
    """Mass of the part in the model, kg; default: of the world's cell."""

    def run(self) -> int:
        """Measures, writes OUT, prints the number and its effect in a model."""
        from vispeg.api.measure.quantity import measure_mass

        settings = self.settings(self.resolution, self.accuracy)
        return self.tell(
            measure_mass(
                self.readings,
                self.out,
                where=self.where,
                nominal=self.nominal,
                world=self.enough.world,
                settings=settings,
            )
        )


@dataclass(frozen=True, kw_only=True)
class Com(_Quantity):
    """Measures a centre of mass, from wrenches at rest or plumb lines on a photograph.

    A table has columns fx fy fz tx ty tz and gravity's direction gx gy gz in the same frame, four attitudes or more; or
    x, y and angle of two plumb lines or more. Recordings hold still in four attitudes or more and have `ft`.

    Example:
        vispeg measure com attitude-a attitude-b attitude-c attitude-d --out com.yaml
    """

    readings: tyro.conf.Positional[tuple[Path, ...]]
    """One table, or recordings."""
    mass: Path | None = None
    """Plumb lines: measurement file of the mass."""
    axes: tuple[str, str] = ("x", "y")
    """Plumb lines: the flange's axes along the photograph's x and y."""

    def run(self) -> int:
        """Measures, writes OUT, prints the number and its effect in a model."""
        from vispeg.api.measure.quantity import measure_com

        settings = self.settings(self.resolution, self.accuracy)
        return self.tell(measure_com(self.readings, self.out, mass_file=self.mass, axes=self.axes, settings=settings))


@dataclass(frozen=True, kw_only=True)
class Friction(_Quantity):
    """Measures a coefficient of friction, on an incline or from forces while sliding.

    Columns: angle (rad, or angle_deg) at which it lets go; with distance and time also how it slid; or normal and
    tangential (N); and place (a number) of three places or more. Recordings have `ft`, begin in free air, and slide.

    Example:
        vispeg measure friction slides.csv --resolution angle_deg=0.1 --out friction.yaml
    """

    readings: tyro.conf.Positional[tuple[Path, ...]]
    """One table, or recordings."""
    where: str | None = None
    """The part, such as fixture, gripper or table; default: the part in the gripper."""
    nominal: float | None = None
    """Coefficient of the part in the model; default: of the world's cell."""

    def run(self) -> int:
        """Measures, writes OUT, prints the number and its effect in a model."""
        from vispeg.api.measure.quantity import measure_friction

        settings = self.settings(self.resolution, self.accuracy)
        return self.tell(
            measure_friction(
                self.readings,
                self.out,
                where=self.where,
                nominal=self.nominal,
                world=self.enough.world,
                settings=settings,
            )
        )


@dataclass(frozen=True, kw_only=True)
class Restitution(_FromTable):
    """Measures a coefficient of restitution.

    Columns: t1 t2 t3 (s) of three touches; or flight1 flight2 (s); or drop bounce (m).

    Example:
        vispeg measure restitution bounces.csv --resolution t1=0.001 t2=0.001 t3=0.001 --out e.yaml
    """

    where: str | None = None
    """The part, such as fixture, gripper or table; default: the part in the gripper."""

    def run(self) -> int:
        """Measures, writes OUT, prints the number and its effect in a model."""
        from vispeg.api.measure.quantity import measure_restitution

        settings = self.settings(self.resolution, self.accuracy)
        world = self.enough.world
        return self.tell(measure_restitution(self.readings, self.out, where=self.where, world=world, settings=settings))


@dataclass(frozen=True, kw_only=True)
class Stiffness(_Quantity):
    """Measures a fixture's stiffness, from presses on a rigid stop and on the fixture.

    Two arm poses or more.

    A table has columns force (N), depth (m), on (0 stop, 1 fixture), and pose and ramp (numbers). Recordings have `ft`,
    begin in free air, and press along the flange's z; the n-th of --stop and of --fixture are of one arm pose.

    Example:
        vispeg measure stiffness presses.csv --resolution force=0.1 depth=1e-5 --out stiffness.yaml
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
    """Stiffness of the contact in the model, N/m, which the result is then a multiple of (contact_stiffness).

    Without it the part gives way along z (fixture_compliance).
    """

    def run(self) -> int:
        """Measures, writes OUT, prints the number and its effect in a model."""
        from vispeg.api.measure.quantity import measure_stiffness

        settings = self.settings(self.resolution, self.accuracy)
        return self.tell(
            measure_stiffness(
                self.readings,
                self.out,
                stop=self.stop,
                fixture=self.fixture,
                where=self.where,
                nominal=self.nominal,
                world=self.enough.world,
                settings=settings,
            )
        )
