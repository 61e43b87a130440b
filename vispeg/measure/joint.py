"""Measure one joint from its recordings: servo, Bode table, backlash, friction, torque limit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.params import Value
from vispeg.measure import frequency, loops, lost_motion, saturation, steps
from vispeg.measure.actuator import alone, step_error
from vispeg.measure.arm import Arm, Loop, inferred, numbers
from vispeg.measure.becomes import placed
from vispeg.measure.frequency import Point
from vispeg.measure.loops import Stroke
from vispeg.measure.steps import Servo, Step
from vispeg.measure.steps_with_friction import Moved, Shared, shared
from vispeg.measure.trace import Trace, angle_noise, refuse_no_servo
from vispeg.measure.uncertainty import Input, propagate, rectangular, repeated, stated
from vispeg.worlds.measurement_file import Quantity

LINEAR = 2e-3  # greatest relative error of a loop's numbers from treating the arm as linear, found in simulation
SHOWING = "steps, or sines of three periods, or a sweep, or ramps out and back"


@dataclass(frozen=True)
class Joint:
    """Results from the recordings of one joint; empty or None for whatever the recordings do not show.

    Attributes:
        traces: the recordings.
        servo: second-order servo that describes the joint, fitted to steps (with dry friction) or, without steps, to
            the frequency response.
        loop: stiffness and damping of the position loop that cause this; None if the inertia is not known.
        steps, points, strokes: single steps, frequencies, and ramps out and back, as measured.
        results: the numbers.
        notes: remarks on them.
        details: tables for the measurement file.
    """

    traces: Sequence[Trace]
    servo: Servo | None = None
    loop: Loop | None = None
    steps: Sequence[Step] = ()
    points: Sequence[Point] = ()
    strokes: Sequence[Stroke] = ()
    results: Sequence[Quantity] = ()
    notes: Sequence[str] = ()
    details: Mapping[str, object] = field(default_factory=dict)


def measure(
    traces: Sequence[Trace], rng: np.random.Generator, arm: Arm | None = None, inertia: float | None = None
) -> Joint:
    """Measure everything about a joint that its traces show.

    Args:
        traces: of the joint.
        rng: of the propagation of distributions.
        arm: the arm with the joint, to compute the loop's stiffness and damping.
        inertia: kg m^2 that the joint turns, from which the loop follows in place of the arm's; None if it is not
            known. The numbers of the effect `servo` state the loop in the arm, whose reference inertia they refer to.

    Raises:
        UserError: the traces show nothing, the angle does not follow its command, or the response to the same steps has
            drifted.
    """
    names = ", ".join(dict.fromkeys(t.name for t in traces))
    refuse_no_servo(traces, names)
    responses = [s for t in traces for s in steps.fitted(t)]
    points = sorted((p for t in traces for p in frequency.points(t)), key=lambda p: (p.hz, p.amplitude))
    strokes = [s for t in traces for s in loops.measured(t)]
    if not responses and not points and not strokes:
        raise UserError("show nothing of a joint", file=names, expected=SHOWING)
    steps.refuse_drift(responses, names)
    results: list[Quantity] = []
    notes: list[str] = []
    details: dict[str, object] = {}
    friction: list[Quantity] = []
    lost_motion.summarise(strokes, traces, friction, notes, details, rng)
    responses = _resolved(responses, friction, notes)
    responses = _limited(responses, traces, friction, notes, details, rng)
    servo = loop = None
    has_inertia = arm is not None or inertia is not None
    if len(responses) >= 2:
        common = shared(responses)
        servo, of_loop, groups = common.servo, [], common.groups
        if has_inertia:
            loop, groups = _loop_of_steps(common, responses, traces, arm, inertia, friction, of_loop, rng)
        _of_steps(common, groups, responses, traces, results, notes, rng)
        results += of_loop
        _early(results, notes)
    else:
        fit = _of_frequencies(points, results, notes, rng)
        if fit is not None:
            servo = fit[0]
            loop = (
                _loop_of_frequencies(fit, points, traces, arm, inertia, friction, results, rng) if has_inertia else None
            )
    _held_out(responses, notes, details)
    _bode(points, results, notes, details, rng)
    results += friction
    if not results:
        why = "; ".join(("no quantity of the joint can be determined", *notes))
        raise UserError(why, file=names, expected="steps, sines up to its bandwidth, or ramps out and back")
    if responses:
        details["steps"] = [
            {"size_rad": size, "repeats": len(group), "left_of_step": float(np.mean([s.rest for s in group]))}
            | {name: float(np.mean([getattr(s.servo, name) for s in group])) for name in steps.NAMES}
            for size, group in steps.groups(responses).items()
        ]
    return Joint(traces, servo, loop, responses, points, strokes, results, notes, details)


def effects(joint: str, measured: Joint) -> tuple[list[EffectInstance], list[str]]:
    """Return the effects, and notes on numbers beyond an effect's bounds, which have none.

    The effects are the joint's friction and backlash, if significantly above 0, and its servo.
    """
    by_name = {q.quantity: q for q in measured.results}
    out, notes = list[EffectInstance](), list[str]()

    def add(name: str, values: Mapping[str, Value], q: Quantity) -> None:
        try:
            out.append(placed(name, joint, values, q))
        except UserError as error:
            notes.append(f"it has no effect in a model: {error}")

    for quantity, name, key in (
        ("coulomb_friction", "coulomb_friction", "torque"),
        ("viscous_friction", "viscous_friction", "damping"),
        ("backlash", "backlash", "gap"),
        ("torque_limit", "torque_limit", "limit"),
    ):
        q = by_name.get(quantity)
        if q is not None and q.low > 0:
            add(name, {key: Value(q.value, q.low, q.high)}, q)
    line = {name: by_name.get(q) for name, q in (("stall", "stall_torque"), ("no_load", "no_load_speed"))}
    values = {name: Value(q.value, q.low, q.high) for name, q in line.items() if q is not None}
    if len(values) == 2:
        add("torque_speed_limit", values, by_name["stall_torque"])
    if any(t.servo for t in measured.traces) and "servo_natural_frequency" in by_name:
        bounds = effect("servo").params
        loop = {name: by_name[f"servo_{name}"] for name in bounds}
        # sag under load looks like a gain too: numbers outside the bounds of the effect `servo` are left out
        inside = {name: q for name, q in loop.items() if bounds[name].low <= q.value <= bounds[name].high}
        if "natural_frequency" in inside:
            values = {name: Value(q.value, q.low, q.high) for name, q in inside.items()}
            add("servo", values, loop["natural_frequency"])
        late = by_name["servo_delay"]
        if late.low > 0:
            add("command_delay", {"delay": Value(late.value, late.low, late.high)}, late)
    return out, notes


def _resolved(responses: list[Step], loop: Sequence[Quantity], notes: list[str]) -> list[Step]:
    """Return the steps of at least twice the lost motion; smaller ones show friction and play, not the servo."""
    lost = next((q.value for q in loop if q.quantity == "lost_motion"), 0.0)
    small = [s for s in responses if abs(s.size) < 2.0 * lost]
    if small:
        listed = ", ".join(f"{size:.3g}" for size in steps.sizes(small))
        notes.append(f"steps of {listed} rad are left out: within twice the lost motion of {lost:.2g} rad")
    return [s for s in responses if s not in small]


def _limited(
    responses: list[Step],
    traces: Sequence[Trace],
    results: list[Quantity],
    notes: list[str],
    details: dict[str, object],
    rng: np.random.Generator,
) -> list[Step]:
    """Add the drive's torque limit to `results` if the steps show one.

    Returns:
        The steps that do not reach the limit if there are two or more of them, else all steps.
    """
    given = [t for t in traces if not t.asked]
    table = saturation.by_speed(given)
    if not table:
        notes.append("no torque limit shows: the log has no signed torque of the motor")
        return responses
    details["greatest_torque"] = table
    found = saturation.limit(responses)
    if found is None:
        most = max(row["greatest_torque_nm"] for row in table)
        notes.append(f"no torque limit shows: the motor gave {most:.3g} N m at most, always as its loop asked")
        return responses
    name, count = "stall_torque" if len(found.slope) else "torque_limit", len(found.reached)

    def add(name: str, unit: str, function: Callable[..., Any], of: Sequence[Input]) -> None:
        results.append(propagate(name, unit, function, of, rng, repeats=count))

    add(name, "N m", lambda *x: sum(x), found.inputs())
    if len(found.slope):
        add("no_load_speed", "rad/s", lambda *x: 1.0 / sum(x), found.inputs_of_slope())
        notes.append("the torque limit falls with the speed")
    rest = [s for s in responses if s not in found.reached]
    listed = ", ".join(f"{size:.3g}" for size in steps.sizes(found.reached))
    what = "are left out" if len(rest) >= 2 else "are kept, as too few others are left, and make the servo seem slower"
    notes.append(f"steps of {listed} rad reach the torque limit: they {what}")
    return rest if len(rest) >= 2 else responses


def _of_steps(
    common: Shared,
    groups: Mapping[str, np.ndarray],
    responses: Sequence[Step],
    traces: Sequence[Trace],
    results: list[Quantity],
    notes: list[str],
    rng: np.random.Generator,
) -> None:
    """Add the servo that describes the joint, its bandwidth, and the band of rest due to friction to `results`.

    `groups` holds the values of each size and direction of step, as `Shared.groups` does.
    """
    count = len(responses)
    for name, unit in steps.NAMES.items():
        results.append(_over_sizes(name, unit, groups[name], _half_period(traces), rng, count))
    bands = np.array([Servo(*(groups[n][k] for n in steps.NAMES)).bandwidth_hz for k in range(len(groups["gain"]))])
    results.append(_over_sizes("bandwidth_from_steps", "Hz", bands, 0.0, rng, count))
    if common.band > 0.0:
        inputs = [
            repeated("sizes and directions", groups["rest_band"]),
            rectangular("noise at rest", angle_noise(traces)),
        ]
        results.append(propagate("rest_band", "rad", lambda *x: sum(x), inputs, rng, repeats=count))
    sizes = steps.sizes(responses)
    if len(sizes) < 3:
        notes.append(f"sizes of step: {len(sizes)}; with three or more, one would be held out as a check")
    worst = float(np.max(common.left))
    if worst > 0.1:
        notes.append(
            f"the joint is not second order: the fit leaves an RMS error of up to {100 * worst:.0f} % of a step"
        )


def _early(results: Sequence[Quantity], notes: list[str]) -> None:
    """Add a note that commands were logged late if the joint answers before its command."""
    by_name = {q.quantity: q for q in results}
    delay = by_name.get("servo_delay", by_name["delay"])
    if delay.high < 0.0:
        late = f"{-1e3 * delay.value:.2g} ms"
        notes.append(
            f"the joint answers {late} before its steps: the commands are logged late, by this and the joint's delay"
        )


def _half_period(traces: Sequence[Trace]) -> float:
    """Return half the time between two rows, s."""
    return 0.5 * max(t.period for t in traces)


def _viscous(friction: Sequence[Quantity]) -> Quantity | None:
    """Return the viscous friction if it is significantly above 0; it is then not part of the servo's damping."""
    return next((q for q in friction if q.quantity == "viscous_friction" and q.low > 0), None)


def _loop_of_steps(
    common: Shared,
    responses: Sequence[Step],
    traces: Sequence[Trace],
    arm: Arm | None,
    inertia: float | None,
    friction: list[Quantity],
    results: list[Quantity],
    rng: np.random.Generator,
) -> tuple[Loop, Mapping[str, np.ndarray]]:
    """Add the loop's stiffness and damping, the numbers of the effect `servo`, and dry friction (N m).

    All but friction go to `results`; dry friction goes to `friction` if it lacks it and the loop is the robot's own.

    Returns:
        The loop, and `common.groups` shifted so that their mean is the servo of a linear arm with this loop.
    """
    groups, left = common.groups, 0.0
    viscous = _viscous(friction)
    drag = 0.0 if viscous is None else viscous.value
    if inertia is not None or arm is None:
        loop, slopes = alone(common.servo, inertia or 1.0, drag)
        of = [Servo(*row) for row in zip(*(groups[name] for name in steps.NAMES), strict=True)]
        each = loop.numbers[:, None] + slopes @ np.array([numbers(servo) - numbers(common.servo) for servo in of]).T
        bands = groups["rest_band"]
    else:
        dragged = arm.with_friction(drag)

        def moving(x: np.ndarray, band: float) -> tuple[Moved, float]:
            return _moved(dragged, Loop.of(x), band), dragged.modes(Loop.of(x))[2]

        look = _look(responses, dragged)
        start, _ = inferred(common.servo, dragged, look)
        x, values, rest = common.nearest(moving, start.numbers)  # now with dry friction, fitted to all steps
        loop, each, bands = Loop.of(x[:4]), values[:4], values[4]
        groups = steps.about(groups, look(loop))
        noise = angle_noise(traces) / np.array([abs(s.size) for s in responses])
        left = float(np.sqrt(max(np.mean(rest**2 - noise**2), 0.0) + LINEAR**2))
    inputs = [repeated(f"{word} over sizes and directions", x) for word, x in zip(WORDS, _five(each), strict=True)]
    misfit = rectangular("residual of the steps", left)
    _of_loop(inputs, misfit, arm, viscous, traces, results, rng, len(responses))
    # not if the control law is known: then slow strokes give friction better, as the torque is known too
    own = any(t.servo for t in traces) and "coulomb_friction" not in {q.quantity for q in friction}
    if np.mean(bands) > 0.0 and own:
        least = left * min(abs(s.size) for s in responses)
        dry = [
            repeated("rest band", bands),
            rectangular("noise at rest", angle_noise(traces)),
            rectangular("residual of the least step", least),
            inputs[1],
        ]
        friction.append(
            propagate(
                "coulomb_friction",
                "N m",
                lambda h, e, r, x: (h + e + r) * np.exp(x),
                dry,
                rng,
                repeats=len(responses),
            )
        )
    return Loop.of(np.array([x.value for x in inputs[:4]])), groups  # the same numbers as in `results`


def _loop_of_frequencies(
    fit: tuple[Servo, np.ndarray, int],
    points: Sequence[Point],
    traces: Sequence[Trace],
    arm: Arm | None,
    inertia: float | None,
    friction: Sequence[Quantity],
    results: list[Quantity],
    rng: np.random.Generator,
) -> Loop:
    """Compute the loop from a fitted frequency response, and add its numbers to `results`."""
    servo, covariance, dof = fit
    viscous = _viscous(friction)
    drag = 0.0 if viscous is None else viscous.value
    if inertia is not None or arm is None:
        loop, slopes = alone(servo, inertia or 1.0, drag)
    else:
        dragged = arm.with_friction(drag)
        hz = np.array([p.hz for p in points])

        def look(loop: Loop) -> Servo:
            same = [replace(p, response=complex(h)) for p, h in zip(points, dragged.response(hz, loop), strict=True)]
            found = frequency.fit(same)
            assert found is not None
            return found[0]

        loop, slopes = inferred(servo, dragged, look)
    five = _five(np.eye(4)) @ slopes
    u = np.sqrt(np.einsum("ki,ij,kj->k", five, covariance, five))
    values = _five(loop.numbers)
    inputs = [
        Input(f"{word} through the frequency response", float(x), float(e), "A", float(dof), "t")
        for word, x, e in zip(WORDS, values, u, strict=True)
    ]
    _of_loop(inputs, rectangular("none", 0.0), arm, viscous, traces, results, rng, len(points))
    return loop


WORDS = ("gain", "logarithm of the stiffness", "logarithm of the damping", "delay", "logarithm of the damping ratio")


def _five(x: np.ndarray) -> np.ndarray:
    """Append a fifth row to the numbers of a loop (4, ...): the logarithm of damping over the root of the stiffness."""
    return np.concatenate([x, (x[2] - 0.5 * x[1])[None]])


def _of_loop(
    inputs: Sequence[Input],
    misfit: Input,
    arm: Arm | None,
    viscous: Quantity | None,
    traces: Sequence[Trace],
    results: list[Quantity],
    rng: np.random.Generator,
    repeats: int,
) -> None:
    """Add stiffness and damping of a loop and, in an arm, the numbers of the effect `servo` to `results`.

    `inputs` holds the five numbers that `WORDS` names; `misfit` is a relative error of all of them but the delay.
    """
    gain, stiff, damp, late, ratio = inputs
    errors = []
    if viscous is not None:  # its value was subtracted from the damping, so its error enters
        errors = [stated("viscous friction", viscous.u, 0.0, np.inf if viscous.dof is None else viscous.dof)]

    def add(name: str, unit: str, function: Callable[..., Any], *of: Input) -> None:
        results.append(propagate(name, unit, function, of, rng, repeats=repeats))

    add("loop_stiffness", "N m/rad", lambda x, e: np.exp(x) * (1 + e), stiff, misfit)
    add("loop_damping", "N m s/rad", lambda x, e, *v: np.exp(x) * (1 + e) - sum(v), damp, misfit, *errors)
    if arm is None:
        return
    root = np.sqrt(arm.reference)
    each = 0.5 * np.exp(-0.5 * stiff.value) / root  # derivative of the damping ratio with respect to the damping
    add("servo_natural_frequency", "rad/s", lambda x, e: np.sqrt(np.exp(x) * (1 + e)) / root, stiff, misfit)
    add(
        "servo_damping_ratio",
        "1",
        lambda x, e, *v: 0.5 * np.exp(x) * (1 + e) / root - each * sum(v),
        ratio,
        misfit,
        *errors,
    )
    add("servo_gain", "1", lambda x, e: x * (1 + e), gain, misfit)
    add("servo_delay", "s", lambda *x: sum(x), late, rectangular("time of a sample", _half_period(traces)))


def _look(responses: Sequence[Step], arm: Arm) -> Callable[[Loop], Servo]:
    """Return a function from a loop to the servo that `steps.fit` finds for the linear arm with that loop.

    The arm is simulated over the time and sampling of the longest of these steps.
    """
    spans = [(s.trace, *steps.rows(s)) for s in responses]
    longest, a, b = max(spans, key=lambda span: span[2] - span[1])
    period = longest.period
    t = np.arange(-round((steps.BEFORE + steps.LATE) / period), b - a) * period
    first = int(np.searchsorted(t, -0.5 * period))
    command = (t > -0.5 * period).astype(float)
    return lambda loop: steps.fit(Trace("arm", t, command, arm.answer(t, loop)), first, len(t)).servo


def _moved(arm: Arm, loop: Loop, band: float) -> Moved:
    """Return the simulation of the arm's joint with this loop and friction band, rad."""
    stiffness = loop.gain * loop.stiffness / arm.modes(loop)[2]  # static stiffness, that of gravity included
    return lambda goals, dt, pulls: arm.dry(loop, band * stiffness, goals, dt, np.clip(pulls, -band, band) * stiffness)


def _of_frequencies(
    points: list[Point], results: list[Quantity], notes: list[str], rng: np.random.Generator
) -> tuple[Servo, np.ndarray, int] | None:
    """Fit the servo to the frequency response, for a joint without steps, and add its numbers to `results`.

    Returns:
        As `frequency.fit`; None if there are too few points or the servo is too uncertain.
    """
    fit = frequency.fit(points)
    if fit is None:
        return None
    servo, covariance, dof = fit
    u = np.sqrt(np.diag(covariance)) * np.array([1.0, servo.natural_frequency, servo.damping_ratio, 1.0])
    if u[1] > servo.natural_frequency or u[2] > servo.damping_ratio:
        notes.append("no steps, and the frequency response does not determine natural frequency and damping ratio")
        return None
    notes.append("no steps: the servo is fitted to the frequency response, which includes dry friction")
    for (name, unit), spread in zip(steps.NAMES.items(), u, strict=True):
        inputs = [Input("fit to the frequency response", getattr(servo, name), float(spread), "A", float(dof), "t")]
        results.append(propagate(name, unit, lambda x: x, inputs, rng, repeats=len(points)))
    return fit


def _over_sizes(
    name: str, unit: str, means: np.ndarray, half: float, rng: np.random.Generator, repeats: int
) -> Quantity:
    """Return the mean over sizes and directions; for positive quantities (such as frequencies) the geometric mean."""
    if name in steps.POSITIVE or unit == "Hz":
        inputs = [repeated("logarithm over sizes and directions", np.log(means))]
        return propagate(name, unit, np.exp, inputs, rng, repeats=repeats)
    inputs = [repeated("sizes and directions", means)]
    inputs += [rectangular("time of a sample", half)] if name == "delay" else []
    return propagate(name, unit, lambda *x: sum(x), inputs, rng, repeats=repeats)


def _held_out(responses: Sequence[Step], notes: list[str], details: dict[str, object]) -> None:
    """Add the error of simulated steps of the middle size, with a servo fitted to the other sizes, to `details`."""
    sizes = steps.sizes(responses)
    if len(sizes) < 3:
        return
    middle = sizes[len(sizes) // 2]
    rest = [s for s in responses if abs(abs(s.size) - middle) > 0.05 * middle]
    held = [s for s in responses if abs(abs(s.size) - middle) <= 0.05 * middle]
    common = shared(rest)
    errors = step_error(common.servo, common.band, held)
    details["held_out"] = {
        "size_rad": middle,
        "steps": len(held),
        "error_of_step": float(np.sqrt(np.mean(np.square(errors)))),
        "worst": max(errors),
    }
    notes.append(
        f"simulated steps of {middle:.3g} rad, which the servo was not fitted to: RMS error "
        f"{100 * details['held_out']['error_of_step']:.2g} % of the step"
    )


def _bode(
    points: Sequence[Point],
    results: list[Quantity],
    notes: list[str],
    details: dict[str, object],
    rng: np.random.Generator,
) -> None:
    """Add the Bode table to `details` and the bandwidth to `results`."""
    if not points:
        return
    details["bode"] = [
        {
            "hz": p.hz,
            "amplitude_rad": p.amplitude,
            "gain": abs(p.response),
            "phase_deg": float(np.degrees(np.angle(p.response))),
            "coherence": p.coherence,
            "u_gain": p.u * abs(p.response),
            "used": p.used,
        }
        for p in points
    ]
    refused = [p for p in points if not p.used]
    if refused:
        listed = ", ".join(f"{p.hz:.3g} Hz ({p.coherence:.2f})" for p in refused[:5])
        more = f" and {len(refused) - 5} more" if len(refused) > 5 else ""
        notes.append(f"refused for a coherence below {frequency.COHERENT}: {listed}{more}")
    bandwidth = frequency.bandwidth(list(points))
    if bandwidth is None:
        top = max((p.hz for p in points if p.used), default=None)
        notes.append(
            "no coherent frequency"
            if top is None
            else f"the gain stays above -3 dB up to {top:.3g} Hz, the highest used"
        )
        return
    hz, u, dof = bandwidth
    inputs = [Input("logarithm about -3 dB", float(np.log(hz)), u / hz, "A", dof, "t")]  # never below 0
    results.append(propagate("bandwidth", "Hz", np.exp, inputs, rng, repeats=sum(p.used for p in points)))
