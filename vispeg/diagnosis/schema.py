"""Types of diagnosis.json and compare.json.

`where` is always the place of an effect: a joint, a body, a camera, or `all`. The noise floor is the error that noise
alone makes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NotRequired, TypedDict

from vispeg.core.provenance import Provenance


class Place(TypedDict):
    """An effect at a place."""

    effect: str
    where: str


class FoundEffect(Place):
    """An added effect with its values, as in a model file.

    Attributes:
        params: its values. `statistical` is the interval without the error of the model's form, where it differs.
        indistinguishable_from: the effects confounded with it.
        without: held-out RMS error of the final model without it, the others unchanged, over the noise floor.
        explains: how much larger the mean squared error then is, over the excess of the user's model above the floor.
        partial: whether it was accepted while a remainder is left.
        tentative: whether something else might lower the error too.
        channel: with several channels: the one that named it.
        was: its values in the baseline, where two states of a robot are compared and both have the effect.
    """

    params: Mapping[str, Mapping[str, object]]
    indistinguishable_from: list[Place]
    without: NotRequired[float]
    explains: NotRequired[float]
    partial: NotRequired[bool]
    tentative: NotRequired[bool]
    channel: NotRequired[str]
    was: NotRequired[Mapping[str, Mapping[str, object]]]


class Rung(TypedDict):
    """RMS error of one model of the ladder, from the user's to the final one; a comparison has the user's only.

    `fit_error` is None if nothing was fitted, `heldout_error` if every rollout diverged.
    """

    model: str
    fit_error: float | None
    heldout_error: float | None
    unit: str


NoiseFloor = TypedDict("NoiseFloor", {"value": float, "unit": str, "from": str})
"""The error that noise alone makes, and where that is known from."""


class Failure(TypedDict):
    """Share of the squared missing torque above noise that lies in one joint and regime (`localise.regimes`)."""

    joint: str
    regime: str
    share: float


Peak = TypedDict(
    "Peak",
    {
        "axis": str,
        "joint": str,
        "from": float,
        "to": float,
        "times_noise": float,
        "times_noise_after": NotRequired[float],
    },
)
"""The worst cell of a map (`localise.peaks`): its bounds, in the unit of `axis`, and RMS missing torque over noise."""


class Channel(TypedDict):
    """Held-out RMS error of one joint in one kind of measurement, by the user's model and by the final one.

    `least_squares` is the error of the best rigid arm with plain friction (`base_parameters`), if torques are compared.
    """

    channel: str
    joint: str
    floor: float
    before: float
    after: float
    unit: str
    least_squares: NotRequired[float]


class Candidate(Place):
    """A rejected candidate and the reason; `tried_beside` are the added effects that its model also had."""

    tried_beside: NotRequired[list[Place]]
    heldout_gain: float
    gain_standard_errors: float
    rejected_because: str


class Screened(Place):
    """A candidate's score: the predicted drop of the squared whitened residual."""

    score: float


class Moved(Place):
    """A parameter that changed when a later effect was added."""

    param: str
    before: float
    after: float


class Correlations(TypedDict):
    """Correlation matrix (n, n) of the final fit's n parameters, named by `labels`."""

    labels: list[str]
    matrix: list[list[float]]


class Remainder(TypedDict):
    """RMS torque of a joint that the final model still lacks, and RMS torque that the joint needed in all."""

    joint: str
    rms: float
    needed: float
    unit: str


class Recordings(TypedDict):
    """Names of the fitted recordings and of the held-out ones (`validate`)."""

    fit: list[str]
    validate: list[str]


class NextMotion(TypedDict):
    """Next recording: a motion written beside the record, or one described in words with instructions for a person."""

    motion: str
    why: str
    how: NotRequired[str]
    expected_separation_sigma: NotRequired[float]
    seed: NotRequired[int]
    duration_s: NotRequired[float]
    rate_hz: NotRequired[float]
    file: NotRequired[str]


class NotExcited(Place):
    """An effect that the recordings cannot show at any size: why, and the motion that would show it."""

    why: str
    motion: str


class Allowed(TypedDict):
    """Shares of a model's held-out squared residual that nuisances (errors that are allowed for) explain."""

    model: str
    sensor: float
    path: float
    form: float


class ShowsFrom(Place):
    """The values of each parameter of an effect `between` which it would go unnoticed; None if every value would."""

    between: dict[str, tuple[float, float] | None]


class Summary(TypedDict):
    """Keys common to every diagnosis, and to the baseline of a change.

    Attributes:
        verdict: `adequate`, `identified`, `ambiguous` or `unexplained`.
        reason: the same in a sentence.
        effects: what was found.
        ladder: errors of each model on the way.
        of: what the ladder's errors are of, with pictures: `borders`, `depth` or `light`.
        noise_floor: the error that noise alone makes.
        recordings: names of the fitted recordings and of those that judged.
    """

    verdict: str
    reason: str
    effects: list[FoundEffect]
    ladder: list[Rung]
    of: NotRequired[str]
    noise_floor: NoiseFloor
    recordings: Recordings


class Lost(TypedDict):
    """A compared piece of a recording whose rollout diverged, and when, s from the start of that piece."""

    recording: str
    time_s: float


class JointError(TypedDict):
    """RMS error of one joint and its noise, their ratio; RMS torque error where torque or load was measured."""

    joint: str
    error: float | None
    floor: float
    unit: str
    times_floor: float | None
    torque_error: NotRequired[float | None]
    load_error: NotRequired[float | None]


class ComparisonRecord(TypedDict):
    """Content of compare.json; keys that are not explained here are as in `DiagnosisRecord`.

    Attributes:
        format: `vispeg-compare/1`.
        chi2: mean squared whitened residual.
        joints: error of each joint.
        diverged: what is left out of every error, since the model's rollout diverged.
        pictures: errors in `cameras`, and in `frames`, worst first: `border_px`, `corner_px`, `depth_mm`, `grey` and
            their medians, `gain`; of depth `fill_rate`, `z_accuracy`, `plane_fit_rms` (%) and `subpixel_rms` (px).
        drift: effects fitted anew to each recording, and whether their values left the model's.
    """

    format: str
    ladder: list[Rung]
    noise_floor: NotRequired[NoiseFloor]
    chi2: NotRequired[float]
    joints: NotRequired[list[JointError]]
    diverged: NotRequired[list[Lost]]
    where_it_fails: NotRequired[list[Failure]]
    residual_peaks: NotRequired[list[Peak]]
    recordings: Recordings
    windows: NotRequired[Sequence[Mapping[str, object]]]
    notes: list[str]
    evidence: NotRequired[str]
    phases: NotRequired[Sequence[Mapping[str, object]]]
    channels: NotRequired[list[Channel]]
    views: NotRequired[Mapping[str, object]]
    pictures: NotRequired[Mapping[str, object]]
    by_channel: NotRequired[list[ChannelRecord]]
    drift: NotRequired[Sequence[Mapping[str, object]]]
    provenance: NotRequired[Provenance]


class Likely(Place):
    """An effect proposed by the linear model of torques: its share of the missing torque, and equally good effects."""

    params: Mapping[str, Mapping[str, object]]
    share: float
    equals: list[Place]


class LeftTorque(TypedDict):
    """RMS torque missing in one joint of the held-out recordings, N m.

    It is `before` with the user's model, `after` with the proposed effects, and `noise` due to noise alone.
    """

    joint: str
    before: float
    after: float
    noise: float


class ProposalRecord(TypedDict):
    """Effects proposed from torques, not confirmed by rollouts; `torque` says where the torques come from."""

    effects: list[Likely]
    torque: str
    before: float
    after: float
    unit: str
    joints: list[LeftTorque]


class ChannelRecord(TypedDict):
    """Result of one of several channels: its name, effects taken from the other channels, and its own record."""

    channel: str
    given: list[Place]
    record: Mapping[str, object]


class Trial(TypedDict):
    """One run of an insertion: its greatest force in N, its time in contact in s, and how it ended.

    `free_off` is the tip's RMS distance from the measured path in free air above the goal, m; absent if the run began
    inside the goal.
    """

    peak_force: float
    contact_s: float
    outcome: str
    free_off: NotRequired[float]


class Replayed(TypedDict):
    """An insertion, measured and run again in models: for each of these, by name, the run."""

    recording: str
    trials: dict[str, Trial]


class DiagnosisRecord(Summary):
    """Content of diagnosis.json, with the keys of `Summary`. Keys that a channel does not have are absent.

    Attributes:
        format: `vispeg-diagnosis/1`.
        unexplained: what the residual depends on (time, position, speed, load, frequency); `shows_in`: one recording
            alone; None where nothing is left to explain.
        next_experiment: the motion to record next; an empty `motion` is none of the menu, and `why` says the reason.
            None where nothing is left to find.
        candidates: what else was tried, and why it was rejected.
        where_it_fails: share of the excess by `joint` (of contact: axis) and `regime` (of contact: phase).
        residual_peaks: worst cell of each map of the residual.
        remainder: torque that each joint still lacks, without noise, and the torque that it needed in all.
        cost: with `--policy`: success with the identified effects, and with the remainder.
        proposal: of joints: what the linear model of torques proposed.
        channels: errors of each joint's angle or torque.
        screening: scores of the candidates.
        correlations: of the final estimates.
        parameters_moved: parameters that a later effect changed.
        not_excited: effects that show at no size, and the motion that excites them.
        shows_from: the minimum detectable size of effects that were not found: outside `between` an effect would be
            found with a probability of 0.9; None: at no size.
        by_channel: with several channels, what each found. Arrays are in `channel/NAME/` of `evidence.npz`.
        views: of pictures: `projection` (shift in px at 0.15, 0.25 and 0.5 m), `confounded` (what the views cannot
            separate), `not_excited`, `halves` (fits to two halves of the views), `remainder`, `sensor`.
        phases: of contact: force error by phase, N RMS.
        worst_left: of contact: the largest force that the model misses.
        allowed: of contact: shares of the residual that nuisances explain: of the sensor, of the path (kinematics), and
            of the form of the contact.
        closed_loop: of contact: a held-out insertion, and its replays in models.
        object: of free objects: the body's name.
        restarts: of free objects: how well short windows and whole tosses determine each effect.
        contact: of free objects: friction, restitution, time constant and damping ratio.
        baseline: with `--baseline`: the diagnosis of the baseline.
        missing: in words: missing readings, and what was left out.
        windows: which parts of long recordings were used.
        notes: remarks.
        evidence: name of the file with arrays.
        provenance: command, seed and versions.
    """

    format: str
    unexplained: Mapping[str, object] | None
    next_experiment: NextMotion | None
    candidates: list[Candidate]
    notes: list[str]
    where_it_fails: NotRequired[list[Failure]]
    residual_peaks: NotRequired[list[Peak]]
    remainder: NotRequired[list[Remainder]]
    cost: NotRequired[Mapping[str, object]]
    proposal: NotRequired[ProposalRecord | None]
    channels: NotRequired[list[Channel]]
    screening: NotRequired[list[Screened]]
    correlations: NotRequired[Correlations | None]
    parameters_moved: NotRequired[list[Moved]]
    windows: NotRequired[Sequence[Mapping[str, object]]]
    missing: NotRequired[list[str]]
    baseline: NotRequired[Summary]
    provenance: NotRequired[Mapping[str, object]]
    object: NotRequired[str]
    restarts: NotRequired[Sequence[Mapping[str, object]]]
    contact: NotRequired[Mapping[str, object]]
    evidence: NotRequired[str]
    phases: NotRequired[Sequence[Mapping[str, object]]]
    worst_left: NotRequired[Mapping[str, object]]
    views: NotRequired[Mapping[str, object]]
    not_excited: NotRequired[list[NotExcited]]
    shows_from: NotRequired[list[ShowsFrom]]
    allowed: NotRequired[list[Allowed]]
    closed_loop: NotRequired[list[Replayed]]
    by_channel: NotRequired[list[ChannelRecord]]
