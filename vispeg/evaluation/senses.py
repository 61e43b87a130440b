"""Find which of a policy's senses differs on the robot: exchange one for simulation's, see how far the action moves.

The policy acts again on the observations of a trial, with one sense taken from simulation. Pictures are rendered with
the arm where the robot's was measured; readings of the arm or the wrench come from a replay of the trial's actions.
This is done with two draws of the world. If the robot were like a third draw, the exchange would move the action as far
as the exchange of one draw for the other. What the robot moves beyond that shows what the simulation lacks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from scipy.stats import ttest_1samp

from vispeg.evaluation.arena import environment
from vispeg.evaluation.jobs import Job
from vispeg.evaluation.schema.explain import Moment, Sense
from vispeg.evaluation.statistics import CANNOT_TELL, Decision, Difference
from vispeg.interface.builder import Picture, images
from vispeg.interface.interface import Interface
from vispeg.interface.terms import FELT, POLICY
from vispeg.recordings.recording import Recording
from vispeg.render.cameras.camera import Camera
from vispeg.render.image_kinds import DEPTH, camera_of, kind_of, picture_of
from vispeg.task.start import Start
from vispeg.trials.trial import Trial

PICTURES, ARM, WRENCH, CONTACT = "pictures", "arm", "wrench in free air", "wrench in contact"
TERMS = {ARM: ("tip", "velocity", "turn", "spin"), WRENCH: FELT, CONTACT: FELT}  # sense -> its observation terms
POINTS_TO = {
    PICTURES: "camera or looks",
    ARM: "the arm or its drives",
    WRENCH: "the wrist's sensor",
    CONTACT: "contact",
}
TOUCH, HELD = 5.0, 3  # contact: force differs from that at the start by this many N, over this many samples
ASSUMED = 0.15  # mm, pose repeatability (ISO 9283) assumed where none is stated: that of a KUKA LBR iiwa 14
DRAWS = 2  # draws of the world for each trial
AT_TIME = 1e-6  # s, largest difference of times that count as equal

Images = Mapping[str, np.ndarray]  # by key, (1, C, H, W)


@dataclass(frozen=True, eq=False)
class Look(Job):
    """A job that renders the places where a robot's pictures were taken.

    Attributes:
        number: numbers of the trial and of the draw.
        places: state of the arm and the goal at each step.
    """

    number: tuple[int, int] = (0, 0)
    places: tuple[Start, ...] = ()

    @classmethod
    def of(cls, job: Job, seed: int, number: tuple[int, int], places: tuple[Start, ...]) -> Look:
        """Return the job of rendering in the world of `job` as `seed` draws it."""
        same = {f.name: getattr(job, f.name) for f in fields(Job)}
        return cls(**{**same, "seeds": (seed,), "replays": None, "trials": None}, number=number, places=places)


def look(job: Look) -> tuple[tuple[int, int], list[Images]]:
    """Render the pictures of a job; return its number, and for each place the images (1, C, H, W) by key."""
    env, (seed,) = environment(job), job.seeds
    taken: list[Images] = []
    for first in range(0, len(job.places), env.num_envs):
        block = job.places[first : first + env.num_envs]
        starts = [*block, *[block[-1]] * (env.num_envs - len(block))]  # rows without a place repeat the last one
        seen, _ = env.reset(seed=[seed] * env.num_envs, options={"start": starts})
        pictures = {key: value for key, value in seen.items() if kind_of(key) is not None}
        taken += [{key: value[[row]].copy() for key, value in pictures.items()} for row in range(len(block))]
    return job.number, taken


def places(trial: Trial) -> tuple[Start, ...]:
    """Return the robot's joint angles and goal at each step of a trial, as starts that leave the world to the seed."""
    rows = np.searchsorted(trial.recording.time, trial.steps.time - AT_TIME)
    begun = trial.said.begin()
    return tuple(Start(trial.recording.q[row], begun.goal, begun.believed) for row in rows)


def seen(trial: Trial, interface: Interface) -> list[Images]:
    """Return the pictures of a trial as its policy saw them, one mapping per step.

    Raises:
        UserError: a step lacks a picture that the policy sees.
    """
    out = []
    for time in trial.steps.time:
        pictures = {}
        for frame in trial.recording.frames or ():
            if abs(frame.time - time) < AT_TIME:
                c = frame.camera
                camera = Camera(c.name, c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.distortion)
                pictures[c.name] = Picture(frame.rgb, frame.depth, camera)
        out.append(images(interface, pictures))
    return out


def before_contact(recording: Recording) -> int:
    """Return the number of samples before contact (TOUCH, HELD); all samples where there is no contact or no wrench."""
    if recording.ft is None:
        return len(recording.time)
    pressed = np.linalg.norm(recording.ft[:, :3] - recording.ft[0, :3], axis=1) > TOUCH
    held = np.convolve(pressed, np.ones(HELD), "valid") >= HELD
    return int(np.argmax(held)) if held.any() else len(recording.time)


@dataclass(frozen=True, eq=False)
class Parting:
    """How one trial's actions move when a sense is exchanged for simulation's.

    Attributes:
        moved: sense -> (steps,) m, distance between the actions with the robot's and with simulation's sense, mean over
            the draws; NaN at steps where the sense is not compared.
        among: sense -> (steps,) m, distance between the actions with the two draws of that sense.
        robot: (steps, k) m, offsets that the policy asks for with the robot's senses.
        simulated: sense -> (steps, k) m, offsets with that sense from the first draw.
    """

    moved: Mapping[str, np.ndarray]
    among: Mapping[str, np.ndarray]
    robot: np.ndarray
    simulated: Mapping[str, np.ndarray]


def part(
    policy: Any, interface: Interface, trial: Trial, replays: Sequence[Trial], drawn: Sequence[Sequence[Images]]
) -> Parting:
    """Let the policy act on a trial's observations again, with one sense at a time from simulation.

    Args:
        policy: see `vispeg.learn.policy.Policy`.
        interface: the meaning of its inputs and outputs.
        trial: a trial of the robot.
        replays: simulated replays of its actions, one per draw.
        drawn: pictures of the same places, one list per draw; empty for a policy without images.
    """
    n = min(len(trial.steps.time), *(len(r.steps.time) for r in replays))
    free = np.arange(n) < min(_free(t) for t in (trial, *replays))
    compared = {PICTURES: np.ones(n, bool), ARM: free, WRENCH: free, CONTACT: ~free}
    drawn = [[_stored(images_of_step, trial) for images_of_step in draw] for draw in drawn]
    pictures = seen(trial, interface) if interface.images else [{}] * n
    columns = {sense: _columns(interface, names) for sense, names in TERMS.items()}
    columns = {sense: indices for sense, indices in columns.items() if len(indices)}  # those that the policy has
    senses = [*([PICTURES] if interface.images else []), *columns]
    rows = [(sense, draw) for sense in senses for draw in range(len(replays))]
    policy.reset(1 + len(rows))  # row 0 has all of the robot's senses
    actions = []
    for step in range(n):
        vectors = np.repeat(trial.steps.seen[[step]], 1 + len(rows), axis=0).astype(np.float32)
        taken = [pictures[step]] * (1 + len(rows))
        for row, (sense, draw) in enumerate(rows, 1):
            if sense == PICTURES:
                taken[row] = drawn[draw][step]
            else:
                vectors[row, columns[sense]] = replays[draw].steps.seen[step, columns[sense]]
        stacked = {key: np.concatenate([images_of_row[key] for images_of_row in taken]) for key in interface.images}
        actions.append(policy.act({POLICY: vectors, **stacked}))
    moves = [i for i, d in enumerate(interface.dof) if not d.startswith("r")]
    asked = interface.offset_m * np.stack(actions)[:, :, moves].astype(float)  # (steps, rows, k)
    offsets = {  # (sense, draw) -> (steps, k) m
        (sense, draw): np.where(compared[sense][:, None], asked[:, row], np.nan)
        for row, (sense, draw) in enumerate(rows, 1)
    }
    robot, moved = asked[:, 0], {}
    for sense in senses:
        distances = [np.linalg.norm(offsets[sense, draw] - robot, axis=1) for draw in range(len(replays))]
        moved[sense] = np.mean(distances, axis=0)
    among = {sense: np.linalg.norm(offsets[sense, 0] - offsets[sense, 1], axis=1) for sense in senses}
    return Parting(moved, among, robot, {sense: offsets[sense, 0] for sense in senses})


def _free(trial: Trial) -> int:
    """Return the number of steps before contact: from then on, the trial and its replay may diverge."""
    touch = before_contact(trial.recording)
    time = trial.recording.time
    return int((trial.steps.time < (time[touch] if touch < len(time) else np.inf) - AT_TIME).sum())


def _stored(pictures: Images, trial: Trial) -> Images:
    """Return the pictures with depth rounded to the unit in which the trial's was stored."""
    units = {name: c.depth_unit for name, c in trial.recording.frames.cameras.items()} if trial.recording.frames else {}

    def rounded(key: str, image: np.ndarray) -> np.ndarray:
        unit = units.get(camera_of(key))
        return np.rint(image / unit).astype(image.dtype) * image.dtype.type(unit) if unit else image

    return {key: rounded(key, image) if kind_of(key) is DEPTH else image for key, image in pictures.items()}


def _columns(interface: Interface, names: Sequence[str]) -> np.ndarray:
    """Return the indices of terms in a policy's vector, in all observations of its stack."""
    ends = np.cumsum([term.size for term in interface.told])
    spans = [range(end - t.size, end) for t, end in zip(interface.told, ends, strict=True) if t.name in names]
    newest = np.array([i for span in spans for i in span], int)
    return np.concatenate([newest + k * ends[-1] for k in range(interface.stack)])


def tests(parted: Sequence[Parting]) -> dict[str, Difference]:
    """Test for each sense whether the robot's differs more from the draws than these differ from each other.

    The measure is the distance of actions; the trial is the unit.
    """
    excess = {sense: _excess(parted, sense) for sense in parted[0].moved}
    return {sense: _by_t(trials) for sense, trials in excess.items() if len(trials)}


def _excess(parted: Sequence[Parting], sense: str) -> np.ndarray:
    """Return `moved` minus `among`, mean over steps, (n,) mm for the n trials in which the sense is compared."""
    each = [p.moved[sense] - p.among[sense] for p in parted]
    return 1e3 * np.array([np.nanmean(x) for x in each if np.isfinite(x).any()])


def _by_t(excess: np.ndarray) -> Difference:
    """Test by t whether the mean excess (n,) mm is 0; without spread, p is 1 at 0 and else None."""
    value = float(excess.mean())
    if len(excess) < 2 or np.ptp(excess) == 0:
        return Difference(1.0 if value == 0 else None, value, lambda alpha: (value, value), len(excess))
    found = ttest_1samp(excess, 0.0)

    def interval(alpha: float) -> tuple[float, float]:
        low, high = found.confidence_interval(1 - alpha)
        return float(low), float(high)

    return Difference(float(found.pvalue), value, interval, len(excess))


def ranked(parted: Sequence[Parting], decided: Mapping[str, Decision], least: float = ASSUMED) -> list[Sense]:
    """Return one row per sense, ordered by how far it moves the action beyond the world's draws, most first.

    If the arm's own readings differ too, contact comes last: the force may differ because the arm was elsewhere.

    Args:
        parted: the moves of each trial's actions.
        decided: the page's decision on each sense.
        least: the arm's repeatability, mm; a sense that moves the action by no more points to nothing.
    """
    speak = [sense for sense, d in decided.items() if d.certain and d.estimate.value > least]
    rows: list[Sense] = []
    for sense, decision in decided.items():
        moved = 1e3 * float(np.nanmean(np.concatenate([p.moved[sense] for p in parted])))
        among = 1e3 * float(np.nanmean(np.concatenate([p.among[sense] for p in parted])))
        points = POINTS_TO[sense] if sense in speak else ""
        if sense == CONTACT and points and ARM in speak:
            points = "contact, unless the arm's motion before it is the reason"
        words = f"{moved:.1f} mm, {among:.1f} mm between two draws of the world"
        rows.append(
            {
                "sense": sense,
                "moved_mm": moved,
                "among_mm": among,
                "more_mm": decision.estimate.to_json(),
                "p_holm": decision.p_holm,
                "points_to": points,
                "words": words if sense in speak or decision.certain else f"{words}: {CANNOT_TELL}",
            }
        )
    return sorted(rows, key=lambda r: (r["sense"] == CONTACT and ARM in speak, -(r["more_mm"]["value"] or 0.0)))


def moment(trials: Sequence[Trial], parted: Sequence[Parting], sense: str) -> Moment:
    """Return the step at which a sense moves the action farthest beyond the draws, in a failed trial if any failed."""
    failed = [i for i, t in enumerate(trials) if not t.said.outcome.success]
    excess = {i: p.moved[sense] - p.among[sense] for i, p in enumerate(parted)}
    compared = {i: x for i, x in excess.items() if np.isfinite(x).any()}
    candidates = [i for i in failed if i in compared] or list(compared)
    number = max(candidates, key=lambda i: float(np.nanmax(compared[i])))
    step, p, trial = int(np.nanargmax(compared[number])), parted[number], trials[number]
    return {
        "number": number,
        "trial": "" if trial.path is None else trial.path.name,
        "sense": sense,
        "step": step,
        "time_s": float(trial.steps.time[step] - trial.steps.time[0]),
        "robot_mm": (1e3 * p.robot[step]).tolist(),
        "simulated_mm": (1e3 * p.simulated[sense][step]).tolist(),
    }


@dataclass(frozen=True, eq=False)
class Strip:
    """One trial's pictures, and simulated ones of the same places.

    Attributes:
        steps: numbers of the n steps shown.
        moment: index in `steps` of the step to highlight.
        robot, simulated: image key -> n pictures (H, W, 3) uint8.
    """

    steps: tuple[int, ...]
    moment: int
    robot: Mapping[str, Sequence[np.ndarray]]
    simulated: Mapping[str, Sequence[np.ndarray]]


def strip(robot: Sequence[Images], simulated: Sequence[Images], step: int) -> Strip:
    """Return the pictures of up to eight steps spread evenly over a trial; `step` is one of them."""
    n = min(len(robot), len(simulated))
    steps = sorted({*np.linspace(0, n - 1, min(n, 7)).round().astype(int).tolist(), step})
    sides = [
        {key: [picture_of(key, side[k][key][0]) for k in steps] for key in robot[0]} for side in (robot, simulated)
    ]
    return Strip(tuple(steps), steps.index(step), *sides)
