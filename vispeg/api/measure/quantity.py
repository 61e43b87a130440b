"""Measure mass, centre of mass, friction, restitution or stiffness; write the result with an effect for models."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from vispeg.api.measure.result import MeasurementResult, MeasureSettings, check_out, write
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.params import Value
from vispeg.core.paths import expanded
from vispeg.core.seeds import stream
from vispeg.core.several import each_once, several
from vispeg.effects.common.parts import body_of, held, shapes, touching
from vispeg.measure import com, friction, mass, restitution, stiffness
from vispeg.measure.becomes import payload, placed, scaled, undeclared
from vispeg.measure.from_recordings import at_rest, declared_tool, presses, slides
from vispeg.measure.outcome import Outcome
from vispeg.measure.readings import Readings, choose, of_instruments, read
from vispeg.robots.scene import FIXTURE
from vispeg.task.registry import scene_of
from vispeg.task.world_file import load_world
from vispeg.worlds.measurement_file import Measurement, Quantity, load_measurement

Effects = Callable[[Sequence[Quantity]], list[EffectInstance]]


def measure_mass(
    readings: str | Path,
    out: str | Path,
    *,
    where: str = "flange",
    nominal: float | None = None,
    world: str = "nominal",
    settings: MeasureSettings | None = None,
) -> MeasurementResult:
    """Measure a mass by a scale: columns mass and, if the empty scale was read before each weighing, tare (kg).

    Args:
        readings: table of readings (.csv, .csv.gz, .parquet); a unit may end a column's name: angle_deg, mass_g, h1_mm,
            t_ms.
        out: the measurement file to write (.yaml).
        where: what was weighed: a thing at the `flange` (payload), or the part in the gripper (object_mass).
        nominal: mass of the part in the model, kg; default: that in the world's cell.
        world: world of the policies, and source of nominal values.
        settings: resolution and accuracy of the scale, conditions, seed, overwrite.

    Raises:
        UserError: an invalid table, an unknown part, or `out` exists.
    """
    settings = settings or MeasureSettings()
    model_mass = None if where == "flange" else _nominal("mass", where, nominal, world)

    def effects(results: Sequence[Quantity]) -> list[EffectInstance]:
        return [payload(results, None) if model_mass is None else scaled(results[0], where, model_mass)]

    return _measured(
        "mass",
        where,
        out,
        [Path(readings)],
        settings,
        lambda rng: mass.measure(_table(readings, settings), rng),
        effects,
    )


def measure_com(
    readings: str | Path | Sequence[str | Path],
    out: str | Path,
    *,
    mass_file: str | Path | None = None,
    axes: tuple[str, str] = ("x", "y"),
    settings: MeasureSettings | None = None,
) -> MeasurementResult:
    """Measure a centre of mass, from wrenches at rest or plumb lines on a photograph.

    The numbers are of everything that the flange carries. The effect is what it carries beside the tool that the
    recordings declare.

    Args:
        readings: one table, or recordings that hold still in four attitudes or more and have a wrench.
        out: the measurement file to write (.yaml).
        mass_file: for plumb lines: measurement file of the mass.
        axes: for plumb lines: the flange's axes along the photograph's x and y.
        settings: as for every measurement.

    Raises:
        UserError: readings that do not determine it, wrong axes, or `out` exists.
    """
    settings = settings or MeasureSettings()
    paths = [Path(path) for path in several(readings)]

    if not set(axes) <= set("xyz") or len(axes) != 2 or len(set(axes)) < 2:
        raise UserError("not two axes", key="--axes", expected="two of x y z", got=" ".join(axes))
    weighed = None if mass_file is None else load_measurement(mass_file).result("mass")
    tool = (0.0, np.zeros(3)) if _is_table(paths) else declared_tool(paths)  # mass, kg, and centre, m

    def measure(rng: np.random.Generator) -> Outcome:
        table = _table(paths[0], settings) if _is_table(paths) else None
        if table is None or choose(table, com.FORMS) == "attitudes":
            for key, stated in (("--mass", mass_file is not None), ("--axes", tuple(axes) != ("x", "y"))):
                if stated:
                    raise UserError(
                        "is for plumb lines", file=paths[0], key=key, expected=f"no {key}: wrenches tell mass and axes"
                    )
        if table is not None:
            return com.measure(table, rng)
        outcome = com.attitudes(_with_instruments(at_rest(paths), settings), rng)
        if not tool[0]:
            return outcome
        note = f"the effect is what the flange carries beside the declared tool of {tool[0]:g} kg"
        return replace(outcome, notes=(*outcome.notes, note))

    def effects(results: Sequence[Quantity]) -> list[EffectInstance]:
        if tool[0]:
            results = undeclared(results, tool, stream(settings.seed, "measure", "com", "undeclared"))
        flat = all(q.quantity != "mass" for q in results)
        return [payload(results, weighed, axes if flat else "xyz")]

    inputs = paths if mass_file is None else [*paths, Path(mass_file)]
    return _measured("com", "flange", out, inputs, settings, measure, effects)


def measure_friction(
    readings: str | Path | Sequence[str | Path],
    out: str | Path,
    *,
    where: str | None = None,
    nominal: float | None = None,
    world: str = "nominal",
    settings: MeasureSettings | None = None,
) -> MeasurementResult:
    """Measure a coefficient of friction, by the angle of an incline, the time down it, or forces while sliding.

    Args:
        readings: one table, or recordings with a wrench that begin in free air and slide.
        out: the measurement file to write (.yaml).
        where: the part, such as fixture, gripper or table; default: the part in the gripper.
        nominal: coefficient of the part in the model; default: that in the world's cell.
        world: world of the policies, and source of nominal values.
        settings: as for every measurement.

    Raises:
        UserError: readings that do not determine it, an unknown part, or `out` exists.
    """
    settings = settings or MeasureSettings()
    paths, part = [Path(path) for path in several(readings)], where or held_part(world)
    model_friction = _nominal("friction", part, nominal, world)

    def measure(rng: np.random.Generator) -> Outcome:
        return friction.measure(
            _table(paths[0], settings) if _is_table(paths) else _with_instruments(slides(paths), settings), rng
        )

    def effects(results: Sequence[Quantity]) -> list[EffectInstance]:
        return [scaled(results[0], part, model_friction)]

    return _measured("friction", part, out, paths, settings, measure, effects)


def measure_restitution(
    readings: str | Path,
    out: str | Path,
    *,
    where: str | None = None,
    world: str = "nominal",
    settings: MeasureSettings | None = None,
) -> MeasurementResult:
    """Measure a coefficient of restitution, from the times of three touches or two flights, or a drop and a bounce.

    Args:
        readings: a table with columns t1 t2 t3 (s), flight1 flight2 (s), or drop bounce (m); a unit may end a column's
            name (t1_ms).
        out: the measurement file to write (.yaml).
        where: the part, such as fixture, gripper or table; default: the part in the gripper.
        world: world of the policies, and source of nominal values.
        settings: as for every measurement.

    Raises:
        UserError: an invalid table, or `out` exists.
    """
    settings, part = settings or MeasureSettings(), where or held_part(world)
    check_part(part, world)

    def effects(results: Sequence[Quantity]) -> list[EffectInstance]:
        q = results[0]
        return [placed("restitution", part, {"e": Value(q.value, q.low, q.high)}, q)]

    return _measured(
        "restitution",
        part,
        out,
        [Path(readings)],
        settings,
        lambda rng: restitution.measure(_table(readings, settings), rng),
        effects,
    )


def measure_stiffness(
    readings: str | Path | None,
    out: str | Path,
    *,
    stop: str | Path | Sequence[str | Path] = (),
    fixture: str | Path | Sequence[str | Path] = (),
    where: str = FIXTURE,
    nominal: float | None = None,
    world: str = "nominal",
    settings: MeasureSettings | None = None,
) -> MeasurementResult:
    """Measure the stiffness of a fixture, from presses on a rigid stop and on the fixture, in two arm poses or more.

    Args:
        readings: a table with columns force (N), depth (m), on (0 stop, 1 fixture), pose, ramp; or omit it and give
            `stop` and `fixture`.
        out: the measurement file to write (.yaml).
        stop: recordings of presses on a rigid stop.
        fixture: recordings of presses on the fixture.
        where: the part, such as fixture, gripper or table.
        nominal: stiffness of the contact in the model, N/m; the effect is then a multiple of it (contact_stiffness).
            Without it, the effect is a compliance along z (fixture_compliance).
        world: world of the policies, and source of nominal values.
        settings: as for every measurement.

    Raises:
        UserError: both a table and recordings, or neither; readings that do not determine it; or `out` exists.
    """
    settings = settings or MeasureSettings()
    stops, fixtures = [Path(path) for path in several(stop)], [Path(path) for path in several(fixture)]
    tables = [] if readings is None else [Path(readings)]
    if (readings is None) == (not stops and not fixtures):
        raise UserError("no readings, or both a table and recordings", expected="a table, or --stop and --fixture")
    check_part(where, world)
    _check_nominal(nominal)

    def measure(rng: np.random.Generator) -> Outcome:
        read = _table(tables[0], settings) if tables else _with_instruments(presses(stops, fixtures), settings)
        return stiffness.measure(read, rng)

    def effects(results: Sequence[Quantity]) -> list[EffectInstance]:
        stiff, soft = results
        if nominal is None and where != FIXTURE:
            raise UserError("the model's own stiffness is not stated", key="--nominal", expected="N/m")
        if nominal is None:
            return [placed("fixture_compliance", where, {"z": Value(soft.value, soft.low, soft.high)}, soft)]
        return [scaled(stiff, where, nominal)]

    return _measured("stiffness", where, out, [*tables, *stops, *fixtures], settings, measure, effects)


def _measured(
    protocol: str,
    of: str,
    out: str | Path,
    inputs: Sequence[Path],
    settings: MeasureSettings,
    measure: Callable[[np.random.Generator], Outcome],
    effects: Effects,
) -> MeasurementResult:
    """Measure and write the result; if it cannot be an effect of a model, add a note with the reason."""
    check_out(expanded(out), settings.overwrite)
    each_once(inputs)
    outcome = measure(stream(settings.seed, "measure", protocol))
    notes, of_model = list(outcome.notes), list[EffectInstance]()
    try:
        of_model = effects(outcome.results)
    except UserError as error:
        notes.append(f"it has no effect in a model: {error}")
    measurement = Measurement(
        protocol,
        of,
        outcome.results,
        tuple(of_model),
        conditions=dict(settings.conditions or {}),
        notes=tuple(notes),
        details=outcome.details,
    )
    return write(measurement, expanded(out), inputs, settings)


def _nominal(what: Literal["mass", "friction"], part: str, nominal: float | None, world: str) -> float:
    """Return the stated nominal value, else that of the cell. Raises UserError: unknown part, or not above 0."""
    of_cell = cell_value(what, part, world)
    _check_nominal(nominal)
    return of_cell if nominal is None else nominal


def _check_nominal(nominal: float | None) -> None:
    if nominal is not None and not 0 < nominal < float("inf"):
        raise UserError("not a nominal value", key="--nominal", expected="above 0", got=nominal)


def _with_instruments(readings: Readings, settings: MeasureSettings) -> Readings:
    """Return readings of recordings with the stated resolution and accuracy of the instruments."""
    return of_instruments(readings, settings.resolution, settings.accuracy)


def _table(readings: str | Path, settings: MeasureSettings) -> Readings:
    """Read a table with the stated resolution and accuracy of the instruments."""
    return read(Path(readings), tuple(settings.resolution), tuple(settings.accuracy))


def _is_table(paths: Sequence[Path]) -> bool:
    return len(paths) == 1 and not paths[0].is_dir()


def cell_value(what: Literal["mass", "friction"], part: str, world: str) -> float:
    """Return the mass (kg) of a part's body, or its coefficient of sliding friction, in a world's cell.

    Raises:
        UserError: an unknown world or part, or a part without the value.
    """
    scene = scene_of(load_world(world).task)
    parts = touching(scene) if what == "friction" else held(scene)
    if part not in parts:
        raise UserError(f"has no {what} that an effect scales", key="--where", got=part, choices=parts)
    model = scene.compile()
    if what == "mass":
        return float(model.body(body_of(part)).mass[0])
    return float(model.geom_friction[shapes(model, part), 0].max())


def check_part(part: str, world: str) -> None:
    """Check that a part makes contact in a world's cell. Raises UserError: it does not, or an unknown world."""
    parts = touching(scene_of(load_world(world).task))
    if part not in parts:
        raise UserError("no such part", key="--where", got=part, choices=parts)


def held_part(world: str) -> str:
    """Return the part that the gripper holds in a world's cell. Raises UserError: an unknown world."""
    return scene_of(load_world(world).task).held
