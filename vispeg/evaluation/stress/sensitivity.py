"""Success against one parameter of one effect: a curve with intervals, and the value at which it has fallen.

A sweep sets the effect in the world to each value in turn, on the same seeds. The null value, at which the effect
changes nothing, is always one of them, and every other value is compared with it on the same seeds. For a measurement,
the two ends of its interval are compared.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from vispeg.core.effect import OPTICAL, effect
from vispeg.core.errors import UserError
from vispeg.evaluation.entrants import Entrant
from vispeg.evaluation.jobs import Setting, has_eyes
from vispeg.evaluation.overlay import HELD, Change
from vispeg.evaluation.records import Episode
from vispeg.evaluation.schema.stress import Curve, SweepPoint, SweepRecord
from vispeg.evaluation.statistics import CANNOT_TELL, Decision, Estimate, Rows, decide, difference, rate
from vispeg.evaluation.stress.interval import ends, verdict, words
from vispeg.evaluation.table import rows
from vispeg.robots.scene import Scene
from vispeg.worlds.identified import acting
from vispeg.worlds.measurement_file import is_measurement, load_measurement
from vispeg.worlds.model_file import load_model
from vispeg.worlds.places import ALL, MANY, check

FORMAT = "vispeg-sensitivity/1"


@dataclass(frozen=True)
class Sweep:
    """The values that parameters of one effect take in turn.

    Attributes:
        effect, where: as in Change.
        params: parameters that take the same value together (such as fx and fy of a focal length).
        values: values in the parameter's unit; for an effect from a file, shares of the way from `start` (0) to `end`
            (1).
        start, end: for an effect from a file, values of `params`: null and the model's, or the low and high ends of a
            measurement's interval. Empty for a sweep by values.
        measured: whether they are the ends of a measurement's interval.
    """

    effect: str
    params: tuple[str, ...]
    values: tuple[float, ...]
    where: str = "*"
    start: tuple[float, ...] = ()
    end: tuple[float, ...] = ()
    measured: bool = False

    def at(self, value: float) -> dict[str, float]:
        """Return the effect's parameters at one of the values."""
        if not self.end:
            return dict.fromkeys(self.params, value)
        return {p: a + value * (b - a) for p, a, b in zip(self.params, self.start, self.end, strict=True)}

    @property
    def unit(self) -> str:
        """Unit of the values."""
        if self.end:
            return "of the interval" if self.measured else "times the value found"
        return effect(self.effect).params[self.params[0]].unit

    @property
    def null(self) -> float:
        """The value at which the effect vanishes; the low end of a measurement's interval."""
        if self.end:
            return 0.0
        return effect(self.effect).params[self.params[0]].null

    @property
    def label(self) -> str:
        """Name of the sweep: `focal_error@wrist_wide.fx,fy`, or `focal_error(wrist_wide)` for an effect from a file."""
        if self.end:
            return f"{self.effect}({self.where})"
        place = "" if self.where == "*" else f"@{self.where}"
        return f"{self.effect}{place}.{','.join(self.params)}"


SWEEPS = {
    "focal-length": Sweep("focal_error", ("fx", "fy"), (0.0, 0.01, 0.02, 0.04, 0.07, 0.1)),
    "camera-shift": Sweep("camera_offset", ("x",), (0.0, 0.002, 0.005, 0.01, 0.02, 0.04)),
    "camera-turn": Sweep("camera_offset", ("rx",), (0.0, 0.01, 0.02, 0.04, 0.08, 0.15)),
    "depth-noise": Sweep("disparity_noise", ("sd",), (0.0, 0.05, 0.1, 0.25, 0.5, 1.0)),
    "light": Sweep("light_intensity", ("gain",), (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)),
    "latency": Sweep("command_delay", ("delay",), (0.0, 0.005, 0.01, 0.015, 0.02, 0.03)),
    "image-latency": Sweep("camera_delay", ("delay",), (0.0, 0.04, 0.08, 0.16, 0.32)),
    "encoder-noise": Sweep("encoder_noise", ("sd",), (0.0, 0.0005, 0.001, 0.002, 0.005, 0.01)),
    "force-bias": Sweep("wrench_bias", ("fx", "fy", "fz"), (0.0, 0.25, 0.5, 1.0, 2.0, 4.0)),
    "force-noise": Sweep("wrench_noise", ("force",), (0.0, 0.1, 0.3, 1.0, 3.0)),
    "friction": Sweep("contact_friction", ("scale",), (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0), HELD),
}


def sweep(text: str) -> Sweep:
    """Return the sweep that a text names or describes: a key of SWEEPS, or EFFECT[@WHERE].PARAM[,PARAM]=VALUE,...

    Raises:
        UserError: neither, an unknown effect or parameter, parameters of several units, or values out of bounds.
    """
    if text in SWEEPS:
        return SWEEPS[text]
    head, equals, tail = text.partition("=")
    place, dot, names = head.rpartition(".")
    if not equals or not dot:
        expected = "EFFECT[@WHERE].PARAM=VALUE,VALUE"
        raise UserError("unknown sweep", key="--sweep", expected=expected, got=text, choices=SWEEPS)
    name, _, where = place.partition("@")
    kind, params = effect(name), tuple(names.split(","))
    together = [kind.param(p, key="--sweep") for p in params]
    if len({(p.unit, p.null) for p in together}) > 1:
        listed = ", ".join(f"{name} {p.null:g} {p.unit}" for name, p in zip(params, together, strict=True))
        expected = "parameters of one unit that vanish at one value"
        raise UserError("cannot take the same values", key="--sweep", expected=expected, got=listed)
    try:
        values = tuple(sorted({float(v) for v in tail.split(",")} | {together[0].null}))
    except ValueError:
        raise UserError("not numbers", key="--sweep", got=tail) from None
    low, high = max(p.low for p in together), min(p.high for p in together)
    for v in values:
        if not low <= v <= high:
            raise UserError("out of bounds", key="--sweep", expected=f"{low:g} to {high:g}", got=v)
    return Sweep(name, params, values, where or "*")


def sweeps(text: str, robot: str) -> list[Sweep]:
    """Return the sweep of a text (see `sweep`), or the sweeps of the effects in a model or measurement file.

    A model's effect is swept from null to its value, a measurement's over its interval.

    Args:
        text: of the sweep, or the file.
        robot: name or path of the world's arm.

    Raises:
        UserError: as `sweep`; a file of another robot, a model without effects, or a measurement without an effect that
            has an interval.
    """
    if not text.lower().endswith((".yaml", ".yml")) or "=" in text:
        return [sweep(text)]
    if is_measurement(text):
        return _measured(text, robot)
    model = load_model(text)
    effects = acting(model.effects, model.robot, robot, text)
    if not effects:
        raise UserError("has no effect to sweep", file=text, expected="a model that a diagnosis wrote")
    nulls = [tuple(effect(e.effect).params[p].null for p in e.params) for e in effects]
    return [
        Sweep(e.effect, tuple(e.params), (0.0, 1.0), e.where, null, tuple(v.value for v in e.params.values()))
        for e, null in zip(effects, nulls, strict=True)
    ]


def _measured(file: str, robot: str) -> list[Sweep]:
    """Return a sweep over the interval of each effect: its low end, its middle, its high end."""
    out, measurement = [], load_measurement(file)
    for e in acting(measurement.effects, measurement.robot, robot, file):
        low, high = (tuple(values.values()) for values in ends(e))
        if low != high:
            out.append(Sweep(e.effect, tuple(e.params), (0.0, 0.5, 1.0), e.where, low, high, measured=True))
    if not out:
        raise UserError("has no effect with an interval", file=file, key="effects", expected="one or more")
    return out


def refuse_unseen(sweeps: Iterable[Sweep], who: Iterable[Entrant]) -> None:
    """Raise UserError for a sweep of an optical effect with a policy without images: its curve would be constant."""
    for what in sweeps:
        for e in who:
            if effect(what.effect).family in OPTICAL and not has_eyes(e):
                raise UserError(
                    f"{what.effect} changes images alone, and {e.name} ({e.modality}) looks at none",
                    key="--sweep",
                    expected="policies that see, or an effect that they feel, such as latency",
                    got=what.label,
                )


def refuse_elsewhere(sweeps: Iterable[Sweep], scene: Scene) -> None:
    """Raise UserError for a sweep of an effect at a place that it does not have in the world's cell."""
    for what in sweeps:
        # an effect at "*" is refused only if it has no place at all
        where = {"*": ALL, HELD: scene.held}.get(what.where, what.where)
        check(effect(what.effect), where, scene, many=MANY, key="--sweep")


def settings(world: str, name: str, what: Sweep) -> list[Setting]:
    """Return one setting per value; the effect is set at null too, so that the world's own range never applies."""
    return [Setting(world, name, tag(what, v), (Change(what.effect, what.at(v), what.where),)) for v in what.values]


def tag(what: Sweep, value: float) -> str:
    """Return the configuration's name of a value's episodes."""
    return f"{what.label}={value:g}"


def summarise(episodes: Sequence[Episode], asked: Sequence[Sweep]) -> list[SweepRecord]:
    """Return one record for each sweep.

    The tests of all values, policies and sweeps are one family. For a measurement, the high end is compared with the
    low end only.
    """
    policies = dict.fromkeys(e.policy for e in episodes)
    played = {
        (policy, tag(what, v)): rows(e for e in episodes if (e.policy, e.configuration) == (policy, tag(what, v)))
        for what in asked
        for policy in policies
        for v in what.values
    }
    costs = {
        (policy, tag(what, v)): difference(
            played[policy, tag(what, what.null)], played[policy, tag(what, v)], same_networks=True
        )
        for what in asked
        for policy in policies
        for v in (what.values[-1:] if what.measured else what.values)
        if v != what.null
    }
    decided = decide(costs)
    return [
        {
            "format": FORMAT,
            "effect": what.effect,
            "params": list(what.params),
            "unit": what.unit,
            "null": what.null,
            "label": what.label,
            "curves": [
                _curve(what, policy, modality, played, decided)
                for policy, modality in {e.policy: e.modality for e in episodes}.items()
            ],
        }
        for what in asked
    ]


def _curve(
    what: Sweep,
    policy: str,
    modality: str,
    played: Mapping[tuple[str, str], Rows],
    decided: Mapping[tuple[str, str], Decision],
) -> Curve:
    points: list[SweepPoint] = []
    fallen: list[SweepPoint] = []  # values at which success is found to be lower
    for v in what.values:
        key = policy, tag(what, v)
        point: SweepPoint = {"value": v, "success": rate(played[key]).to_json()}
        points.append(point)
        if (cost := decided.get(key)) is not None:
            point["cost"], point["p_holm"], point["verdict"] = cost.estimate.to_json(), cost.p_holm, cost.verdict
            if cost.certain and cost.estimate.value > 0:
                fallen.append(point)
    nearest = min(fallen, key=lambda q: abs(q["value"] - what.null), default=None)
    return {
        "policy": policy,
        "modality": modality,
        "points": points,
        "falls_at": nearest["value"] if nearest else None,
        "words": _interval_words(decided[policy, tag(what, what.values[-1])].estimate)
        if what.measured
        else _words(points, nearest, what),
    }


def _interval_words(cost: Estimate) -> str:
    """Return a sentence on success at the high end of a measured interval against the low end."""
    low, high = -cost.high, -cost.low
    moved = 0.0 - cost.value  # the minus sign alone would turn 0 into -0, which is shown as -0.0
    return words(moved, low, high, verdict(low, high, cost.n))


def _words(points: Sequence[SweepPoint], nearest: SweepPoint | None, what: Sweep) -> str:
    unit = "" if what.unit == "1" else f" {what.unit}"
    if nearest is not None:
        return f"lower from {nearest['value']:g}{unit} on (or nearer: between the values tried)"
    verdicts = [q["verdict"] for q in points if "verdict" in q]
    if verdicts and all(v == "equal" for v in verdicts):
        return f"holds over {min(what.values):g} to {max(what.values):g}{unit}"
    return CANNOT_TELL + ": no value is lower beyond doubt, and not all are equal within the margin"
