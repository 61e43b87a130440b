"""One joint from its recordings: servo, Bode table, backlash, friction, torque-speed curve."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.params import Value
from vispeg.measure import frequency, loops, lost_motion, steps
from vispeg.measure.actuator import step_error
from vispeg.measure.becomes import placed
from vispeg.measure.frequency import Point
from vispeg.measure.loops import Stroke
from vispeg.measure.steps import Servo, Step
from vispeg.measure.trace import Trace, refuse_no_servo
from vispeg.measure.uncertainty import Input, propagate, rectangular, repeated
from vispeg.worlds.measurement_file import Quantity

NOTHING = "neither steps, nor sines of three periods, nor a sweep, nor ramps out and back"


@dataclass(frozen=True)
class Joint:
    """What the recordings of one joint show; empty where they do not.

    Attributes:
        servo: the mean over sizes and directions of the steps, or through the frequency response.
        steps, points, strokes: as measured, one by one.
        results: the numbers.
        notes: what to know about them.
        details: tables for the file.
    """

    traces: Sequence[Trace]
    servo: Servo | None = None
    steps: Sequence[Step] = ()
    points: Sequence[Point] = ()
    strokes: Sequence[Stroke] = ()
    results: Sequence[Quantity] = ()
    notes: Sequence[str] = ()
    details: Mapping[str, object] = field(default_factory=dict)


def measure(traces: Sequence[Trace], rng: np.random.Generator) -> Joint:
    """Everything that the traces show of a joint.

    Raises:
        UserError: they show nothing, the angle does not follow its command, or the same steps answer otherwise later.
    """
    names = ", ".join(dict.fromkeys(t.name for t in traces))
    refuse_no_servo(traces, names)
    responses = [s for t in traces for s in steps.fitted(t)]
    points = sorted((p for t in traces for p in frequency.points(t)), key=lambda p: (p.hz, p.amplitude))
    strokes = [s for t in traces for s in loops.measured(t)]
    if not responses and not points and not strokes:
        raise UserError(
            "show nothing of a joint", file=names, expected=NOTHING.replace("neither", "").replace("nor", "or")
        )
    steps.refuse_drift(responses, names)
    results: list[Quantity] = []
    notes: list[str] = []
    details: dict[str, object] = {}
    loop: list[Quantity] = []
    lost_motion.summarise(strokes, traces, loop, notes, details, rng)
    responses = _resolved(responses, loop, notes)
    servo = _servo(responses, points, traces, results, notes, rng)
    _held_out(responses, traces, notes, details)
    _bode(points, results, notes, details, rng)
    results += loop
    if not results:
        raise UserError("gives no number of a joint", file=names, expected="; ".join(notes) or "steps, sines or ramps")
    if responses:
        details["steps"] = [
            {"size_rad": size, "repeats": len(group), "left_of_step": float(np.mean([s.rest for s in group]))}
            | {name: float(np.mean([getattr(s.servo, name) for s in group])) for name in steps.NAMES}
            for size, group in steps.groups(responses).items()
        ]
    return Joint(traces, servo, responses, points, strokes, results, notes, details)


def effects(joint: str, measured: Joint) -> list[EffectInstance]:
    """What the numbers become: the joint's friction and backlash, where they are above nothing, and its own servo."""
    by_name = {q.quantity: q for q in measured.results}
    out = []
    for quantity, name, key in (
        ("coulomb_friction", "coulomb_friction", "torque"),
        ("viscous_friction", "viscous_friction", "damping"),
        ("backlash", "backlash", "gap"),
    ):
        q = by_name.get(quantity)
        if q is not None and q.low > 0:
            out.append(placed(name, joint, {key: Value(q.value, q.low, q.high)}, q))
    loop = [by_name[k] for k in ("natural_frequency", "damping_ratio", "gain") if k in by_name]
    if any(t.servo for t in measured.traces) and len(loop) == 3:
        bounds = effect("servo").params
        # the gain is the sag under load as much as the servo's own: left out where it is no gain that a servo has
        inside = [q for q in loop if bounds[q.quantity].low <= q.value <= bounds[q.quantity].high]
        if loop[0] in inside:
            out.append(placed("servo", joint, {q.quantity: Value(q.value, q.low, q.high) for q in inside}, loop[0]))
    return out


def _resolved(responses: list[Step], loop: Sequence[Quantity], notes: list[str]) -> list[Step]:
    """Steps beyond twice the lost motion: what is smaller shows friction and play, not the servo."""
    lost = next((q.value for q in loop if q.quantity == "lost_motion"), 0.0)
    small = [s for s in responses if abs(s.size) < 2.0 * lost]
    if small:
        listed = ", ".join(f"{size:.3g}" for size in steps.sizes(small))
        notes.append(f"steps of {listed} rad are left out: within twice the lost motion of {lost:.2g} rad")
    return [s for s in responses if s not in small]


def _servo(
    responses: Sequence[Step],
    points: list[Point],
    traces: Sequence[Trace],
    results: list[Quantity],
    notes: list[str],
    rng: np.random.Generator,
) -> Servo | None:
    """The servo's four numbers and the bandwidth that they give."""
    if len(responses) >= 2:
        means = steps.parameters(responses)
        if len(means["gain"]) < 2:
            means = {name: np.array([getattr(s.servo, name) for s in responses]) for name in steps.NAMES}
        half = 0.5 * max(t.period for t in traces)
        for name, unit in steps.NAMES.items():
            results.append(_over_sizes(name, unit, means[name], half, rng, len(responses)))
        servo = steps.mean_servo(responses)
        if results[-1].high < 0.0:  # the delay
            late = f"{-1e3 * servo.delay:.2g} ms"
            notes.append(
                f"the joint answers {late} before its steps: the commands are logged late, by that and its delay"
            )
        bands = np.array([Servo(*row).bandwidth_hz for row in zip(*means.values(), strict=True)])
        results.append(_over_sizes("bandwidth_from_steps", "Hz", bands, half, rng, len(responses)))
        sizes = steps.sizes(responses)
        if len(sizes) < 3:
            notes.append(f"{len(sizes)} sizes of step; with three, one is held out to judge on")
        worst = max(s.rest for s in responses)
        if worst > 0.1:
            notes.append(f"a second-order answer leaves up to {100 * worst:.0f} % of a step: it is not of that kind")
        return servo
    fit = frequency.fit(points)
    if fit is None:
        return None
    servo, u, dof = fit
    if u[1] > servo.natural_frequency or u[2] > servo.damping_ratio:
        notes.append("no steps, and the frequency response does not tell natural frequency and damping ratio")
        return None
    notes.append("no steps: the servo is fitted to the frequency response")
    for (name, unit), spread in zip(steps.NAMES.items(), u, strict=True):
        inputs = [Input("fit to the frequency response", getattr(servo, name), float(spread), "A", float(dof), "t")]
        results.append(propagate(name, unit, lambda x: x, inputs, rng, repeats=len(points)))
    return servo


def _over_sizes(
    name: str, unit: str, means: np.ndarray, half: float, rng: np.random.Generator, repeats: int
) -> Quantity:
    """The mean over sizes and directions: of what is positive and spreads in proportion, that of its logarithm."""
    if name in steps.POSITIVE or unit == "Hz":
        inputs = [repeated("logarithm over sizes and directions", np.log(means))]
        return propagate(name, unit, np.exp, inputs, rng, repeats=repeats)
    inputs = [repeated("sizes and directions", means)]
    inputs += [rectangular("time of a sample", half)] if name == "delay" else []
    return propagate(name, unit, lambda *x: sum(x), inputs, rng, repeats=repeats)  # type: ignore[arg-type]


def _held_out(responses: Sequence[Step], traces: Sequence[Trace], notes: list[str], details: dict[str, object]) -> None:
    """The error on the steps of the middle size, simulated with a servo from the others alone."""
    sizes = steps.sizes(responses)
    if len(sizes) < 3:
        return
    middle = sizes[len(sizes) // 2]
    rest = [s for s in responses if abs(abs(s.size) - middle) > 0.05 * middle]
    held = [s for s in responses if abs(abs(s.size) - middle) <= 0.05 * middle]
    errors = step_error(steps.mean_servo(rest), traces, held)
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
    """The Bode table, and the bandwidth of the amplitude with the most frequencies."""
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


__all__ = ["Joint", "effects", "measure"]
