"""Every number that decides something in a diagnosis: what it decides, for which channel, and what asked for it.

Read from top to bottom it follows a diagnosis: what is compared, what is proposed, accepted, exchanged, dropped and
named, the verdict, and what is said beside it. Numerical tolerances, sizes of pictures, limits of memory and time,
bandwidths of filters and physical constants are not here: they stand where they are used.

A rule has a `reason` (a quantile, a level, an accuracy) or a `case` (the data that asked for it), each as far as it is
known, and the commit that set its value. Modules read `RULES.tie` when they need it, so `varied(tie=0.0)` tells what a
rule does. docs/rules.md is the table of all.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from typing import Any, Literal

Channel = Literal["all", "joints", "contact", "pictures", "tosses"]


@dataclass(frozen=True)
class Rule:
    """One number, and what is known of it.

    Attributes:
        name: under which `RULES` has it.
        value: of the number.
        channel: that it decides something in; `all` for more than one.
        decides: what it decides, in one sentence.
        commit: that set the value.
        reason: why it has this value; empty where none is known.
        case: the data or the case that asked for it; empty where none is known.
        tried: what a diagnosis without it, or with another value, did (scripts/bench/rules.py).
    """

    name: str
    value: float | tuple[float, ...]
    channel: Channel
    decides: str
    commit: str
    reason: str = ""
    case: str = ""
    tried: str = ""

    @property
    def evidence(self) -> str:
        """Return the reason, the case, the commit and what was tried in one line."""
        known = "; ".join(part for part in (self.reason, self.case) if part)
        return f"{known or 'none known'} ({self.commit})" + (f"; {self.tried}" if self.tried else "")


def _rule(
    value: float | tuple[float, ...],
    channel: Channel,
    commit: str,
    decides: str,
    *,
    reason: str = "",
    case: str = "",
    tried: str = "",
) -> Any:
    """Return the field of a rule; its name is that of the attribute."""
    known = {"channel": channel, "decides": decides, "commit": commit}
    return field(default=value, metadata=known | {"reason": reason, "case": case, "tried": tried})


@dataclass(frozen=True)
class Compared:
    """Which data are compared, and what counts as noise."""

    # fmt: off
    settle: float = _rule(0.4, "joints", "2fcabec5",
        "Seconds at the start of a stretch that are not judged.",
        reason="the start state is not measured and its error fades")
    settle_observed: float = _rule(1.2, "joints", "d3946098",
        "The same where only an observer or a null space forgets a wrong start.",
        reason="the observer's 8 rad/s leave under 1 in 1000 of it")
    runaway_speed: float = _rule(3.0, "joints", "47e115cb",
        "Times its rated speed from which a joint's loop has lost the arm.",
        reason="no loop that holds its arm reaches it")
    runaway_before: float = _rule(0.1, "joints", "47e115cb",
        "Seconds before such a speed that are left out.",
        reason="errors grow before they show")
    runaway_after: float = _rule(1.0, "joints", "47e115cb",
        "Seconds after such a speed that are left out.")
    saturated_beyond: float = _rule(1.5, "joints", "fb73cacf",
        "Times the greatest torque that the motion needed, from which a drive did not give what it was asked for.")
    saturated_share: float = _rule(0.5, "joints", "fb73cacf",
        "Share of the samples with such a demand, from which a position loop counts as open.")
    saturated_flat: float = _rule(0.25, "joints", "fb73cacf",
        "Share of its mean by which the torque that a saturated drive gives may vary.")
    beyond_stop: float = _rule(0.05, "joints", "fb73cacf",
        "Angle (rad) beyond a stated stop from which the stop is left out of the model.",
        reason="no encoder's offset and no stop's give is more")
    posture: float = _rule(0.05, "joints", "24523092",
        "RMS angle (rad) of a joint from which an OSC recording is compared in the measured posture.",
        reason="inertia and gravity differ by some per cent there")
    touch_before: float = _rule(0.03, "joints", "d380f188",
        "Seconds before a contact that joints do not judge.")
    touch_after: float = _rule(0.5, "joints", "d380f188",
        "Seconds after a contact that joints do not judge.",
        reason="until a null space has forgotten it")
    touch_graze: float = _rule(0.1, "joints", "d380f188",
        "Seconds after a contact in which a lighter force still acts on the model's arm.")
    touch_light: float = _rule(1.0, "joints", "d380f188",
        "Force (N) from which a measured contact acts on the model's arm.",
        reason="less hardly moves an arm under soft control")
    still_angle: float = _rule(1e-3, "joints", "66fd68e7",
        "Range (rad, m) of angles or goals up to which nothing moves.")
    still_torque: float = _rule(0.1, "joints", "66fd68e7",
        "Range (N m) of commanded torque up to which nothing moves.")
    still_noise: float = _rule(10.0, "joints", "66fd68e7",
        "Stated noises that the range of a joint at rest may span.",
        reason="the range of 10^6 normal readings is about 10 standard deviations")
    torque_repeats: float = _rule(0.02, "joints", "d3946098",
        "Share of spread: noise of a torque sensor, where none is stated, and difference of two runs of one motion.",
        reason="what differs so little between two runs adds no more noise than is assumed without them",
        case="two runs of a KUKA LWR4+ differ by 0.0008 of their motion, other motions by more than all of it")
    load_noise: float = _rule(0.2, "joints", "0b8fe262",
        "Noise of a servo's load reading as a share of its spread.",
        reason="an estimate from current or duty cycle is no sensor")
    grid_step: float = _rule(4.0, "joints", "8a3542a9",
        "Noises that an encoder's step must exceed to be read off the readings.",
        reason="an estimated noise is never less than step / sqrt(12)")
    grid_readings: int = _rule(6, "joints", "8f055d1b",
        "Different readings under which a joint stands still and shows no step.")
    grid_off: float = _rule(0.05, "joints", "8f055d1b",
        "Share of a step by which a reading may lie off the grid.")
    noise_quantile: float = _rule(0.9, "joints", "f10230da",
        "Quantile, over draws, of how far fed-back noise moves the right model: that much is its noise floor.",
        reason="one draw in ten exceeds it",
        case="OSC arms with the right model that were called unexplained")
    noise_quantile_coarse: float = _rule(0.5, "joints", "e07bb19d",
        "The same where encoders are coarse.",
        reason="the draws differ by where in a step the arm began; a floor so wide would hide effects")
    coarse: float = _rule(2.0, "joints", "e07bb19d",
        "Noises as a reading's error from which an encoder counts as coarse.")
    noise_magnified: float = _rule(10.0, "joints", "671f1452",
        "Noise variances that fed-back noise leaves of the right model, from which no effect is looked for.",
        case="effects of micrometres named on an effect-free arm near a singular posture")
    loud: float = _rule(10.0, "joints", "7abebd9a",
        "Multiple of the greatest held-out squared error (of the noise at least) from which a fitted recording shows "
        "something that no held-out one does: before the search it judges too, after it nothing is identified.",
        case="a drive that saturates in two of three motions and not in the held-out one")
    half_least: float = _rule(2.4, "joints", "c0359c29",
        "Seconds that half a recording must last to judge the other half.",
        reason="twice `settle_observed`")
    tip_near: float = _rule(3e-3, "contact", "a91c3c0d",
        "Height (m) over a surface under which a tip may touch it, so that contact is a channel.")
    tip_round: float = _rule(0.05, "contact", "a91c3c0d",
        "Margin (m) about the fixture that counts as over it.")
    contact_block: float = _rule(0.04, "contact", "65a197ce",
        "Seconds of a block, over which forces of contact are means.",
        reason="such a mean has little of a solver's chatter")
    block_read: float = _rule(0.5, "contact", "b4c55ada",
        "Share of a block's samples that must be read for it to count.",
        case="wrench samples that a force sensor lost")
    rest_least: float = _rule(0.3, "contact", "65a197ce",
        "Seconds at rest in free air that an episode must begin with.")
    rest_most: float = _rule(1.0, "contact", "65a197ce",
        "Seconds of that rest that tell the sensor's zero.")
    rest_speed: float = _rule(0.01, "contact", "0319eca4",
        "Speed (m/s) of tip or flange under which the hand rests.")
    rest_softest: float = _rule(2e3, "contact", "5af1f35e",
        "Stiffness (N/m) that a force must change by along the way from its rest for the hand to have been pressed.",
        reason="rubber has 10 N/mm and more")
    rest_sigmas: float = _rule(3.0, "contact", "5af1f35e",
        "Standard deviations of the reading that are no such change.",
        reason="three standard deviations")
    weight_felt: float = _rule(2.0, "contact", "bce7ef5c",
        "Weight (N) of a tool from which a wrench that is not it is refused.")
    weight_towards: float = _rule(0.5, "contact", "bce7ef5c",
        "Cosine of the angle to the weight under which the wrench is refused.",
        reason="a tool may weigh otherwise, not turn its weight round")
    weight_times: float = _rule(4.0, "contact", "bce7ef5c",
        "Ratio to the weight from which the wrench is refused.",
        reason="a wrong unit is off by more")
    weight_zeroed: float = _rule(8.0, "contact", "bce7ef5c",
        "Force (N) at rest from which a wrench is refused that is said to be zeroed there.")
    stuck_speed: float = _rule(0.005, "contact", "cb9cd3d1",
        "Speed (m/s) of a tip under which its contact sticks.")
    sensor_least: float = _rule(0.1, "contact", "65a197ce",
        "Force (N) that no sensor is better than.")
    place_least: float = _rule(5e-5, "contact", "65a197ce",
        "Place (m) that no kinematics are better than.")
    contact_far: float = _rule(4.0, "contact", "0319eca4",
        "Noise floors from which an error of contact counts linearly (25 before).")
    contact_correlated: float = _rule(6.0, "contact", "65a197ce",
        "Blocks in a row over which an error of form is one and the same.",
        reason="it lasts as long as a contact does")
    contact_lasting: float = _rule(14.0, "contact", "e9949f56",
        "Blocks over which an error of form acts on a parameter one way.",
        reason="a visit to a phase takes as long")
    contact_rough: float = _rule(5.0, "contact", "4cfd3ec2",
        "Change of the squared residual that a solver's chatter makes.",
        case="worlds 1e-3 of an effect apart differed by 5 to 15")
    chatter: float = _rule(3, "contact", "98b720e7",
        "Times `contact_rough` that an effect must gain at least.",
        reason="from the least to the most of 5 to 15")
    floor_form: tuple[float, ...] = _rule((0.02, 0.01, 0.04, 0.05, 2.0), "contact", "cb0b46b3",
        "Force (N) that another law of contact leaves of the right model: free, press, slide, inside the goal, impact.",
        case="what the truth left on development cases")
    floor_share: tuple[float, ...] = _rule((0.002, 0.003, 0.007, 0.01, 0.03), "contact", "ef8d5bde",
        "The same as a share of the force of contact.",
        case="at 0.1 % of a press a stiff arm's give was named where nothing was hidden")
    floor_wedged: float = _rule(0.1, "contact", "8e245e45",
        "More of it inside the goal, where a part wedges.",
        reason="0.1 mm of its roundness turns the hand by mrad")
    floor_rocked: float = _rule(0.15, "contact", "0319eca4",
        "Angle (rad) to the goal's axis at which a part surely wedges.")
    floor_loose: int = _rule(2, "contact", "cb9cd3d1",
        "Blocks before and after a slide that have its floor.",
        reason="no model says when exactly a contact breaks loose")
    zero_between: float = _rule(0.3, "contact", "65a197ce",
        "Force (N) by which a sensor's zero may differ from one start to another.")
    zero_drift: float = _rule(0.15, "contact", "d95395ee",
        "Force (N) by which a sensor's zero drifts over a recording.",
        reason="of a sensor that warms up")
    cross_talk: float = _rule(0.01, "contact", "d95395ee",
        "Share of each channel that shows in each other one.",
        reason="what calibration leaves")
    read_late: float = _rule(5e-4, "contact", "0319eca4",
        "Seconds by which readings are older than their time says.")
    kinematics_place: float = _rule(2e-4, "contact", "9a0e906e",
        "Distance (m) by which forward kinematics may be off within a cell.",
        reason="twice what an arm repeats a pose to, for no calibration makes it as true",
        case="at half of it a soft grip was named where nothing was hidden")
    kinematics_turn: float = _rule(4e-4, "contact", "9a0e906e",
        "The same of turns (rad).",
        case="the same")
    kinematics_far: float = _rule(0.02, "contact", "d95395ee",
        "Way (m) over which that error changes.")
    kinematics_twist: float = _rule(0.5, "contact", "8e245e45",
        "Turn (rad) over which that error changes.")
    bears_aside: float = _rule(0.15, "contact", "4a08f3e6",
        "Radii of its end by which a pressed part may bear aside of its axis.",
        reason="half of what four points of a rim leave open")
    slide_blows: float = _rule(0.1, "contact", "0319eca4",
        "Share of a slide's scatter by which it may drag otherwise.")
    slide_across: float = _rule(0.1, "contact", "5f5e4870",
        "Share of its drag by which a slide may drag across.",
        reason="in the model every slide hops, and a tool whose mass is off its axis swings aside")
    stick_blocks: int = _rule(5, "contact", "cb9cd3d1",
        "Blocks before a tip sticks whose blows say where it came to stick.")
    grip_nearly: float = _rule(0.75, "contact", "bf23067b",
        "Share of what a grip holds from which a blow moves the part in it (0.5 before).",
        reason="slips follow hard blows alone")
    grip_slip: float = _rule(1.5e-4, "contact", "bf23067b",
        "Length (m) of such a slip (0.3 mm before).")
    wedge_surely: float = _rule(1.1, "contact", "b6c3c184",
        "Times the net force that two forces across a part must sum to for it to wedge.")
    wedge_depth: float = _rule(4e-3, "contact", "b6c3c184",
        "Depth (m) under which a part leans on an edge and does not wedge.")
    torque_holds: float = _rule(1.0, "contact", "a91c3c0d",
        "Seconds over which friction in joint torques keeps its sign, where no force sensor is.")
    noise_louder: float = _rule(1.15, "contact", "d95395ee",
        "Ratio to the stated noise of a sensor from which it is louder.",
        reason="stated figures are rounded")
    noise_sigmas: float = _rule(3.0, "contact", "d95395ee",
        "Standard errors by which it must be.",
        reason="three standard deviations")
    frames_least: int = _rule(6, "pictures", "367f443f",
        "Frames of a camera that a recording must have.",
        reason="fewer say nothing about views that were not fitted")
    frames_sensor: int = _rule(4, "pictures", "fbb7d3b1",
        "Frames that must show a figure of depth or light.")
    frame_still: float = _rule(2e-4, "pictures", "7a1c05b5",
        "Angle (rad) by which joints may move between frames that count as repeats of one view.",
        reason="0.1 px of a picture 320 px wide at 0.3 m")
    edge_step: float = _rule(6.0, "pictures", "cb619a46",
        "Grey levels over which an edge must go to be found.")
    edge_times: float = _rule(4.0, "pictures", "cb619a46",
        "Times what noise alone gives, that it must go over, too.",
        reason="four standard deviations")
    edge_faint: float = _rule(15.0, "pictures", "367f443f",
        "Grey levels up to which texture and shadows may make an edge as well.")
    edge_rival: float = _rule(0.7, "pictures", "367f443f",
        "Share of an edge's strength from which another one near it makes it doubtful.")
    edge_beside: float = _rule(2.0, "pictures", "367f443f",
        "Distance (px) from a border at which both its sides must be what the model has there.")
    edge_tukey: float = _rule(4.685, "pictures", "367f443f",
        "Scatters beyond which an edge belongs to something else.",
        reason="Tukey's weights, 95 % efficient for normal errors")
    edge_shift: float = _rule(0.1, "pictures", "fbb7d3b1",
        "Shift (px) that light and shadow make of all edges that face one way, lie between two parts or at one place.",
        case="measured on rendered pictures in looks of S against the borders of the model")
    edge_shift_here: float = _rule(0.05, "pictures", "fbb7d3b1",
        "The same of two parts in one picture.",
        case="the same")
    edge_place: float = _rule(0.02, "pictures", "4b61a492",
        "Length (m) of a part that has one shading.")
    thing_known: tuple[float, float] = _rule((1e-3, 5e-3), "pictures", "367f443f",
        "Accuracy (m, rad) to which fixture and grip are known.")
    board_known: tuple[float, float] = _rule((1e-2, 3e-2), "pictures", "ca4dbcdc",
        "The same of a board that was laid down.")
    posture_frame: float = _rule(1.25e-3, "pictures", "7a1c05b5",
        "Angle (rad) that a joint may be off by in a frame.",
        reason="1 mm at 0.8 m, of an arm that nobody calibrated (Slamani, Nubiola and Bonev, Industrial Robot 39(1))")
    robot_half: float = _rule(0.5, "pictures", "36f8b40b",
        "Share to which a free read-out time must bring the arm's errors to be taken instead.",
        reason="three quarters of their variance are then no arm's",
        case="a read-out time that was taken for the arm's errors")
    field_gain: float = _rule(2.7, "pictures", "6ff9609c",
        "Log likelihood that a field of shifts over the image must gain.",
        reason="1 %, half of chi squared (Self and Liang 1987)",
        case="a smear on the lens beside errors of the joints")
    astray: float = _rule(0.25, "pictures", "367f443f",
        "Share of borders without an edge within half a pixel from which the camera is looked for far off.")
    figure_depth: tuple[float, float] = _rule((1e-3, 4e-3), "pictures", "7a1c05b5",
        "Error of depth as a share of distance: what a calibration repeats to, and what good cameras differ by.",
        reason="a D400's 2 % is a limit for all of them")
    figure_lean: tuple[float, float] = _rule((3e-4, 1e-3), "pictures", "fbb7d3b1",
        "The same two of the lean of depth across or down the image.")
    figure_scatter: tuple[float, float] = _rule((0.05, 0.35), "pictures", "fbb7d3b1",
        "The same two of the scatter of depth, on a logarithmic scale.")
    figure_missing: tuple[float, float] = _rule((5e-3, 0.015), "pictures", "943fe8b5",
        "The same two of the share of missing readings.")
    figure_near: tuple[float, float] = _rule((0.03, 0.15), "pictures", "fbb7d3b1",
        "The same two of the share of a near thing's depth beside its border.")
    figure_light: tuple[float, float] = _rule((0.1, 0.3), "pictures", "fbb7d3b1",
        "The same two of the level of light, in octaves.")
    figure_colour: tuple[float, float] = _rule((0.05, 0.15), "pictures", "fbb7d3b1",
        "The same two of red and blue, in octaves.")
    figure_falloff: tuple[float, float] = _rule((0.05, 0.25), "pictures", "fbb7d3b1",
        "The same two of the fall-off of light to the corners.")
    figure_softness: tuple[float, float] = _rule((0.1, 0.35), "pictures", "fbb7d3b1",
        "The same two of the softness of borders, in px^2.")
    figure_smear: tuple[float, float] = _rule((5.0, 20.0), "pictures", "4b61a492",
        "The same two of softness over squared speed, in ms^2.")
    figure_noise: tuple[float, float] = _rule((0.1, 0.6), "pictures", "fbb7d3b1",
        "The same two of noise by brightness, on a logarithmic scale.")
    flights_least: int = _rule(20, "tosses", "1eb50084",
        "Windows of free flight from which the noise floor is taken.")
    toss_near: float = _rule(3e-3, "tosses", "1eb50084",
        "Distance (m) to the table within which an object may touch it.")
    toss_far: float = _rule(8.0, "tosses", "1eb50084",
        "Noise floors from which an error counts linearly.")
    block: float = _rule(0.25, "all", "2fcabec5",
        "Seconds of a block, the unit of the tests over held-out recordings.")
    folds: int = _rule(4, "joints", "b805ac3c",
        "Parts of the only fitted recording that predict one another.")
    cap: float = _rule(1e7, "joints", "6d175ccd",
        "Squared whitened residual beyond which a reading counts no more.",
        reason="one wild reading must not decide")
    # fmt: on


@dataclass(frozen=True)
class Proposed:
    """Proposal of candidates: before any rollout, by a linear screen, and in groups."""

    # fmt: off
    first_slow: float = _rule(0.05, "joints", "ecf3a9b7",
        "Speed (rad/s) below which a joint's torque has no part in the first proposal.",
        reason="a stuck joint's friction is whatever it must be")
    first_form: float = _rule(0.05, "joints", "ecf3a9b7",
        "Share of a joint's missing torque that is no evidence in the first proposal.",
        reason="no law is exact")
    first_typical: float = _rule(3.0, "joints", "ecf3a9b7",
        "Typical sizes that the prior of a size is wide in the first proposal.")
    first_shape: float = _rule(0.25, "joints", "ecf3a9b7",
        "Width of the prior of a shape in the first proposal, as a share of its range.")
    first_gain: float = _rule(1.0, "joints", "ecf3a9b7",
        "Nats that a move of the first proposal must gain.",
        reason="a factor of e in odds")
    first_tie: float = _rule(3.0, "joints", "ecf3a9b7",
        "Nats within which another effect is as likely in the first proposal.",
        reason="odds of 20 to 1")
    first_looked: int = _rule(6, "joints", "ecf3a9b7",
        "Moves of one kind whose held-out error is asked in the first proposal.")
    first_rounds: int = _rule(6, "joints", "ecf3a9b7",
        "Rounds in which the first proposal corrects its variances.")
    first_same: float = _rule(1.2, "joints", "ecf3a9b7",
        "Ratio of variances up to which those that were assumed hold.")
    first_most: int = _rule(40, "joints", "ecf3a9b7",
        "Effects of the first proposal at most.")
    suspect: float = _rule(0.02, "joints", "2fcabec5",
        "Share of the worst joint's squared missing torque from which a joint is screened first.")
    suspects: int = _rule(4, "joints", "2fcabec5",
        "Joints that are screened first at most.")
    promise: float = _rule(0.3, "joints", "1a2442b3",
        "Share of the gain a step needs that the screen must promise for a fit.",
        reason="the screen is linear, so what it promises may fall short")
    group: float = _rule(0.97, "joints", "b805ac3c",
        "Share of a group's promise from which one effect alone is tried instead.",
        tried="off, no change on coulomb_friction/joint4/small of seed 4711 (b8ca1027)")
    fitted: int = _rule(7, "joints", "1a2442b3",
        "Candidates that are fitted at a step.")
    fitted_surely: int = _rule(4, "joints", "1a2442b3",
        "Of these, as many are fitted however little they promise.")
    fitted_share: float = _rule(0.25, "joints", "1a2442b3",
        "Share of the best candidate's promise under which the others are not fitted.")
    same_start: float = _rule(0.2, "joints", "abbb5d6f",
        "Share of a value within which two starts of a pair of effects are one.")
    figure_odd: float = _rule(0.8, "pictures", "fbb7d3b1",
        "Times what good cameras differ by, from which a figure of depth or light asks for an effect.")
    figure_changed: float = _rule(0.2, "pictures", "fbb7d3b1",
        "The same by which a typical size of an effect must change a figure to be tried, or to be excited.")
    felt: float = _rule(5.0, "contact", "65a197ce",
        "Standard deviations by which some size must move the residual for an effect to be excited.")
    screen_flat: float = _rule(0.03, "contact", "4a08f3e6",
        "Share of the longest direction under which changes of accepted effects are one and the same.")
    size_share: float = _rule(0.03, "contact", "d95395ee",
        "Share of the best parameter's gain under which another parameter of an effect is not fitted.")
    size_promise: float = _rule(0.4, "contact", "f3200763",
        "Share of the needed gain that a straight line must promise for a size to be asked again (0.5 before).")
    size_hope: float = _rule(0.25, "contact", "8e245e45",
        "Share of that which the screen by a part of the recordings must see.")
    size_faint: float = _rule(0.03, "contact", "e39a6576",
        "Share of the best promise under which no greater size is tried.")
    size_close: float = _rule(0.1, "contact", "e39a6576",
        "Share of a promise within which a size has come to it.")
    contact_promise: float = _rule(0.6, "contact", "8e245e45",
        "Share of the needed gain that the best size must promise for an effect to be fitted.")
    contact_worth: float = _rule(0.2, "contact", "65a197ce",
        "Share of the best effect's promise under which another one is not fitted.")
    contact_fitted: int = _rule(5, "contact", "65a197ce",
        "Effects that are fitted at a step.")
    contact_paired: int = _rule(3, "contact", "65a197ce",
        "Of these, those whose pairs are fitted, too; and rivals of an effect at most.")
    edge: float = _rule(0.005, "all", "45b9c56e",
        "Share of a range from its bound within which a value stands at the bound.")
    several_least: float = _rule(0.02, "joints", "9e47cadb",
        "Share of the error left that one more of several effects must promise.",
        reason="as `gain` of one effect")
    several_link: float = _rule(0.1, "joints", "fbd72ba7",
        "The same of a link's mass or centre, or a payload.",
        reason="links stay few, or they cancel one another")
    several_common: float = _rule(0.5, "joints", "fbd72ba7",
        "Share of the best promise in a joint from which what every arm has (friction, rotor, bias) is taken instead.")
    several_likelier: float = _rule(0.8, "joints", "e3f41922",
        "Share of an effect's promise from which a likelier one is taken in its place.",
        case="a payload that came in as masses of links beside other effects (0.9 before)")
    several_better: float = _rule(0.995, "joints", "9e47cadb",
        "Share of the error that an exchange in the linear model must leave at most.",
        case="two biases accepted for a tilted base")
    several_looked: int = _rule(8, "joints", "9e47cadb",
        "Candidates whose bounds are checked at each addition.")
    several_rounds: int = _rule(3, "joints", "9e47cadb",
        "Rounds of exchanges in the linear model after an addition.")
    # fmt: on


@dataclass(frozen=True)
class Accepted:
    """Acceptance of fitted candidates, and the choice among those accepted."""

    # fmt: off
    gain: float = _rule(0.02, "all", "6d175ccd",
        "Share of the held-out squared error that an effect must remove.")
    gain_torque: float = _rule(0.002, "joints", "6d175ccd",
        "The same where torques are compared without a controller.",
        reason="what no rigid arm explains is most of that error, and stays")
    effects: int = _rule(32, "joints", "9e47cadb",
        "Effects that a search may add.",
        reason="friction sits in every joint")
    gain_sensor: float = _rule(0.03, "pictures", "367f443f",
        "The same of a sensor's figures of depth or light.")
    effects_few: int = _rule(6, "all", "65a197ce",
        "The same of contact, and of borders in pictures.")
    effects_fewest: int = _rule(4, "pictures", "1eb50084",
        "The same of a sensor's figures.")
    later: float = _rule(0.001, "all", "f15b2aa2",
        "Share of what the effects so far typically removed that a later one must remove.",
        reason="no model is exact",
        tried="off, no change on coulomb_friction/joint4/small of seed 4711 (b8ca1027)")
    later_pictures: float = _rule(0.01, "pictures", "367f443f",
        "The same of a sensor's effects.",
        reason="what the form of an effect leaves is not another effect")
    discoveries: float = _rule(0.01, "all", "b805ac3c",
        "Rate of false discoveries over all places that were screened.",
        reason="Benjamini and Hochberg, 1 %")
    large: float = _rule(0.4, "all", "e3f41922",
        "Share of the held-out squared error from which blocks need less significance.",
        reason="a fit of other recordings hardly removes as much by chance",
        case="a torque limit, which acts at times (0.5 in 3fbb93d7)",
        tried="off, no change on coulomb_friction/joint4/small of seed 4711 (b8ca1027)")
    large_level: float = _rule(0.05, "all", "3fbb93d7",
        "Level of the test over blocks where so much goes.",
        reason="5 %, one-sided")
    held_out: float = _rule(1.645, "all", "b805ac3c",
        "Standard errors that a gain needs in the held-out recordings alone.",
        reason="5 %, one-sided")
    held_out_large: float = _rule(1.0, "all", "e3f41922",
        "The same where `large` goes.",
        reason="a recording of 5 s has twenty blocks, and such a gain may lie in few")
    shift_px: float = _rule(0.2, "pictures", "6cd6d11d",
        "Shift of the borders (px) that an effect must make.",
        reason="looks, and what is not modelled of edges, do not make it")
    moving_px: float = _rule(0.12, "pictures", "6cd6d11d",
        "The same of a delay or a rolling shutter.",
        reason="what only motion makes is not made by a look")
    views_apart: float = _rule(0.5, "pictures", "6cd6d11d",
        "Share of an effect's shift by which the held-out recording, fitted alone, may differ on it.",
        reason="cross-validation, as in mrcal")
    contact_level: float = _rule(0.01, "contact", "8e245e45",
        "Chance that any effect of the library passes where there is none.",
        reason="1 %, Bonferroni over the library; twice that one-sided on the held-out recordings")
    contact_tie: float = _rule(0.02, "contact", "65a197ce",
        "Share of the greatest difference up to which blocks do not tell two models apart.")
    contact_decisive: float = _rule(60.0, "contact", "d95395ee",
        "Drop of the held-out squared residual that tells two models apart in however few blocks.")
    contact_alike: float = _rule(0.03, "contact", "d1d3f51c",
        "Share of what an effect removes that does not tell it from a rival.",
        reason="laws of contact are off by as much of a force")
    contact_tied: float = _rule(5.41, "contact", "35ea2f18",
        "Quantile of chi squared up to which a rival is as good.",
        reason="2 %, one degree of freedom",
        case="a held object's mass that came out where the tool was heavier")
    form_beside: float = _rule(0.1, "contact", "e39a6576",
        "Share of what is left of form that an effect beside others must remove.",
        reason="no law of contact is exact")
    refinement: float = _rule(0.03, "joints", "54ffd752",
        "Share of what an effect removed that one of the same kind beside it must remove.",
        reason="no model of friction is exact")
    clear: float = _rule(0.8, "joints", "3fbb93d7",
        "Share of the held-out error that no mere refinement removes.")
    clear_of_angle: float = _rule(0.2, "joints", "82e9c37c",
        "The same of a torque that depends on the angle alone.",
        reason="no form of friction leaves one")
    alone: float = _rule(0.8, "all", "954b27c7",
        "Share of the held-out error from which one effect is taken before several.",
        case="the demo's arm: several at a time named what was not there",
        tried="off, no change on coulomb_friction/joint4/small of seed 4711 (b8ca1027)")
    tie: float = _rule(0.03, "all", "2fcabec5",
        "Share of the error, or of the best promise, within which candidates are equals.",
        tried="off, no change on coulomb_friction/joint4/small of seed 4711 (b8ca1027)")
    tie_room: float = _rule(0.3, "all", "2fcabec5",
        "Noise variances that count as left when equals are compared at the noise floor.",
        tried="off, no change on coulomb_friction/joint4/small of seed 4711 (b8ca1027)")
    tie_sigma: float = _rule(2.0, "all", "2fcabec5",
        "Standard errors under which two held-out errors are equal by chance.",
        reason="2.3 %, one-sided")
    correlated: float = _rule(0.9, "all", "e3bdc84a",
        "Correlation of two estimates from which neither is a sure name and either comes last.",
        case="a mass more in one link and less in the next: each is needed beside the other")
    # fmt: on


@dataclass(frozen=True)
class Exchanged:
    """What takes the place of an effect, and which rivals are asked."""

    # fmt: off
    exchange: float = _rule(0.01, "all", "c6d6e56d",
        "Share of the held-out error, and in a search of the fitted one, that an exchange of effects must remove.",
        case="effects at a bound in the place of others")
    exchanges: int = _rule(3, "all", "fbd72ba7",
        "Exchanges of an effect with its rival at most.")
    on_steps: int = _rule(3, "joints", "7abebd9a",
        "Steps that a search without a doubtful effect may take to become better.",
        case="a wrist's voltage limit at its bound, in the place of its friction, rotor inertia and bias",
        tried="off, no change on coulomb_friction/joint4/small of seed 4711 (b8ca1027)")
    gather_steps: int = _rule(1, "joints", "39bb29f5",
        "Steps that a search with one load in the place of several links may take.",
        case="a payload that came in as masses and centres of three links")
    decisive: float = _rule(0.5, "joints", "3fbb93d7",
        "Share of what is left that a richer effect in the place of a simple one must remove.",
        case="gear play that was taken for a rotor's inertia")
    richer_sigma: float = _rule(3.0, "all", "ea475dcf",
        "Standard errors by which a richer effect must be better to be a rival.",
        reason="0.1 %: it contains the chosen one, so it is never worse")
    law_scales: tuple[float, ...] = _rule((1.0, 3.0), "joints", "64d409e6",
        "Multiples of a guess at which a richer effect is tried.",
        case="gear play behind a light rotor")
    law_fitted: int = _rule(2, "joints", "64d409e6",
        "Starts of each richer effect that are fitted.",
        case="the same")
    rivals_full: int = _rule(3, "joints", "65a197ce",
        "Effects up to which the whole library is screened for rivals of each.")
    rivals_screened: int = _rule(5, "joints", "2fcabec5",
        "Rivals of an effect that the screen proposes at most.")
    rivals_linear: int = _rule(3, "joints", "9e47cadb",
        "Rivals that the linear model proposes at most.")
    contact_rival: float = _rule(0.3, "contact", "e39a6576",
        "Share of what an effect removes that a rival of it must promise.")
    rival_far: float = _rule(3.0, "joints", "7757c625",
        "Times what the chosen effect leaves over the noise from which the fit of a rival gives up.")
    rival_room: float = _rule(0.1, "joints", "7757c625",
        "Noise variances that count as left at least, for `rival_far`.")
    # fmt: on


@dataclass(frozen=True)
class Dropped:
    """Removal of effects that become superfluous once others are added."""

    # fmt: off
    drop_member: float = _rule(2.0, "joints", "b805ac3c",
        "Standard errors by which a member of a group must lower the error to stay.",
        reason="2.3 %, one-sided: it has had no test of its own")
    drop_single: float = _rule(1.645, "all", "b805ac3c",
        "The same for an effect that passed a test of its own.",
        reason="5 %, one-sided")
    drop_local: float = _rule(0.01, "joints", "b805ac3c",
        "Share of the error in its own joint that a member of a group must remove.")
    drop_rise: float = _rule(0.05, "joints", "45b9c56e",
        "Share by which the held-out error may rise when something goes out.",
        case="deletions after which the held-out error rose, since no straight line led there")
    drop_chance: float = _rule(1.0, "joints", "b04a4732",
        "Standard errors by which it may rise when only the fitted recordings call an effect useless.")
    sparse_level: float = _rule(0.05, "contact", "99c33128",
        "Chance that a parameter that is there is taken for absent.",
        reason="5 %")
    drop_nothing: float = _rule(0.1, "joints", "e76c6eab",
        "Share of `gain` under which an effect goes out that may be absent, however sure its gain.",
        tried="off, no change on coulomb_friction/joint4/small of seed 4711 (b8ca1027)")
    # fmt: on


@dataclass(frozen=True)
class Named:
    """Which effects of a model may be named, and which are tentative."""

    # fmt: off
    part_level: float = _rule(0.05, "pictures", "7a1c05b5",
        "Level of the test that parts of an effect (scale, offset, lean of depth) are absent.",
        reason="Wald, 5 %")
    name_costs: float = _rule(0.3, "joints", "9e47cadb",
        "Share of the error left by which the error must rise without a named effect, beside any other candidate.",
        case="biases that stood in for a tilted base")
    name_costs_far: float = _rule(1.0, "joints", "0b929084",
        "The same where more than `far` is left.",
        reason="what removes less than is left may make up for a little of it")
    name_slack: float = _rule(0.2, "joints", "9e47cadb",
        "Share of the error left by which a rival that is worth a fit may be worse.")
    name_alike: float = _rule(0.7, "joints", "de0de97d",
        "Share of its own cost under which an effect's cost beside another calls them alike.",
        case="a stand-in that fits one motion better than the truth and is worse on another")
    name_rivals: int = _rule(6, "joints", "356154d4",
        "Rivals that may shake a name at most.")
    name_class: int = _rule(3, "joints", "9e47cadb",
        "Proven rivals beyond which an effect is tentative.",
        reason="a class of effects says nothing")
    law: float = _rule(2.0, "contact", "5f5e4870",
        "Times the nominal stiffness or damping of a contact up to which another law of contact explains it.")
    combined_part: float = _rule(0.3, "contact", "0385cc02",
        "Share of a direction that recordings do not determine, from which an effect has a part in it.")
    repeats: float = _rule(0.5, "contact", "4a08f3e6",
        "Share of `kinematics_place` to which an arm repeats a pose, and no pose is named that is smaller.",
        reason="0.1 mm, a KUKA iiwa's data sheet")
    interval: float = _rule(3.84, "contact", "cb9cd3d1",
        "Rise of the squared residual at the ends of an interval.",
        reason="95 % of chi squared, one degree of freedom")
    interval_faint: float = _rule(0.03, "contact", "88a17a00",
        "Share of a derivative's length under which a recording says nothing of a value.")
    interval_less: float = _rule(0.5, "contact", "0bbdbdd4",
        "Share of that rise that counts at least where much less of the residual was met on the way.",
        case="intervals without a width")
    interval_bent: float = _rule(1.2, "contact", "4cfd3ec2",
        "Ratio of variances up to which the other values hardly move along.")
    left_least: float = _rule(0.01, "joints", "81a0e25b",
        "Noise variances that count as left at a place where nothing shows.")
    parts: int = _rule(4, "joints", "858007e9",
        "Parts of time or range over which an effect must be constant.")
    parts_remove: float = _rule(0.3, "joints", "858007e9",
        "Share of the error left in a joint that values of their own for the parts remove.",
        case="friction that falls while a gear warms up, or sits at one angle alone")
    parts_apart: float = _rule(0.5, "joints", "858007e9",
        "Share of an effect's value by which those of the parts differ.",
        case="the same")
    # fmt: on


@dataclass(frozen=True)
class Concluded:
    """The verdict."""

    # fmt: off
    at_floor: float = _rule(1.25, "joints", "1a2442b3",
        "Noise variances of held-out error at which nothing is left to look for (1.2 before).")
    adequate: float = _rule(1.6, "all", "2fcabec5",
        "Noise variances of held-out error up to which a model stands at the noise floor.")
    explained: float = _rule(0.97, "all", "2fcabec5",
        "Share of the held-out excess over noise that an identified model must explain.")
    far: float = _rule(100.0, "all", "25a39308",
        "Noise variances in any kind of channel above which no model is identified.",
        reason="ten times the noise",
        case="a model so wrong that 97 % of its error left 25 times the noise")
    inertial: float = _rule(1.25, "joints", "f121f501",
        "Times what least squares of all inertial parameters leaves, up to which a model is identified.",
        reason="a remainder no greater is none that a rigid arm with plain friction could mend")
    phase_bar: float = _rule(1.0, "contact", "8ed68c9f",
        "Variances of the floor that a model may leave in each phase of contact (1.7 before).",
        reason="the floor counts what the right model leaves")
    phase_spread: float = _rule(2.6, "contact", "8e245e45",
        "Standard deviations by which a mean over few blocks may lie above.",
        reason="0.5 %, one-sided")
    blow_parted: float = _rule(0.08, "contact", "5f5e4870",
        "Share of a blow's peak under which the tool flies.")
    blow_brush: float = _rule(5.0, "contact", "5f5e4870",
        "Times the threshold of a touch up to which a peak is no blow.")
    blow_noise: float = _rule(6.0, "contact", "d1d3f51c",
        "Standard deviations of the sensor that this threshold is at least.")
    blow_impulse: float = _rule(0.15, "contact", "5f5e4870",
        "Share of a blow's impulse that the right model leaves.")
    blow_impulse_least: float = _rule(0.01, "contact", "5f5e4870",
        "Impulse (N s) that it leaves at least.")
    blow_flight: float = _rule(0.25, "contact", "5f5e4870",
        "Share of a blow's flight that the right model leaves.")
    blow_flight_least: float = _rule(4e-3, "contact", "5f5e4870",
        "Flight (s) that it leaves at least.",
        reason="its ends are read to a sample or two")
    blow_hang: float = _rule(2.0, "contact", "d1d3f51c",
        "Readings of a blow whose errors are one.")
    blows_explained: float = _rule(2.0, "contact", "d1d3f51c",
        "Mean squared error up to which a damping explains blows.")
    peak_share: float = _rule(0.25, "contact", "6446e633",
        "Share of the measured peak force that an insertion run again may be off by.",
        reason="paths part where contacts come and go")
    peak_least: float = _rule(1.0, "contact", "6446e633",
        "The same of a faint one, in N.")
    arm_free: float = _rule(1e-4, "contact", "6446e633",
        "RMS (m) of the tip in free air up to which the arm by itself goes as it was measured.")
    visible_px: float = _rule(0.2, "pictures", "367f443f",
        "Shift (px) that place, part or distance must predict for the verdict to be unexplained.")
    moved_share: float = _rule(0.03, "pictures", "2f00f054",
        "Share of the remainder that does as well, where the shift is `moved_px`.",
        case="a moved part, most of whose edges are no longer near it")
    moved_px: float = _rule(1.0, "pictures", "2f00f054",
        "Shift (px) that nothing else makes.",
        reason="several times what pictures without such a fault leave")
    left_points: int = _rule(30, "pictures", "367f443f",
        "Fitted points of a place, part or distance from which its shift is told.")
    left_points_held: int = _rule(15, "pictures", "367f443f",
        "The same of held-out points.")
    moved_sigma: float = _rule(3.0, "pictures", "97667a06",
        "Times `thing_known` by which a thing may stand elsewhere in the held-out recordings.",
        reason="three standard deviations",
        case="a fixture that was moved between the recordings")
    moved_points: int = _rule(30, "pictures", "99421fcc",
        "Points that the place of a thing needs.")
    halves_sigma: float = _rule(2.0, "pictures", "367f443f",
        "Standard errors by which fits to two halves of the views may differ.",
        reason="2.3 %, by Student's t of few views")
    halves_px: float = _rule(0.25, "pictures", "367f443f",
        "Difference (px) of the halves up to which nothing is said.")
    lost: float = _rule(0.5, "pictures", "367f443f",
        "Share of predicted borders without an edge from which the pictures show something else.")
    flat_corners: int = _rule(8, "pictures", "ca4dbcdc",
        "Corners of a board in a view from which its flatness is told.",
        reason="six numbers are the view's own pose")
    flat_bend: float = _rule(5.0, "pictures", "ca4dbcdc",
        "Height (mm) that the corners of a board may stand out by.")
    depends: float = _rule(0.15, "all", "2fcabec5",
        "Share of the missing torque, or shift, that an input must predict to be told.")
    channel_rounds: int = _rule(3, "all", "e38b9f33",
        "Times each channel is asked while others have news for it.")
    # fmt: on


@dataclass(frozen=True)
class Told:
    """Results beside the verdict: minimum detectable sizes, the next motion, whether a robot changed."""

    # fmt: off
    power: float = _rule(0.9, "all", "43dfe918",
        "Probability with which an effect of the least visible size is found.",
        reason="nine times in ten")
    next_sigma: float = _rule(3.0, "all", "0df63f4c",
        "Sigma between two predictions below which no next motion is proposed.",
        reason="three standard deviations")
    profile_wide: float = _rule(4.0, "tosses", "1eb50084",
        "Ratio of an interval's ends from which a window's length does not determine a parameter.")
    profile_flat: float = _rule(0.02, "tosses", "1eb50084",
        "Share by which the error must vary over a parameter's profile for it to be determined.")
    changed: float = _rule(0.05, "joints", "d4fa7c72",
        "Level, over all values and recordings, of a robot's change.",
        reason="Holm, 5 %")
    # fmt: on


STEPS: tuple[type, ...] = (Compared, Proposed, Accepted, Exchanged, Dropped, Named, Concluded, Told)


@dataclass(frozen=True)
class Rules(Told, Concluded, Named, Dropped, Exchanged, Accepted, Proposed, Compared):
    """The values of all rules, by name."""


RULES = Rules()


def rules(step: type) -> list[Rule]:
    """Return the rules of one of the `STEPS`, in order."""
    return [Rule(f.name, getattr(RULES, f.name), **f.metadata) for f in fields(step)]


@contextmanager
def varied(**values: float | tuple[float, ...]) -> Iterator[None]:
    """Return rules other values while the block lasts."""
    unknown = sorted(values.keys() - {f.name for f in fields(Rules)})
    if unknown:
        raise KeyError(f"no such rule: {', '.join(unknown)}")
    before = {name: getattr(RULES, name) for name in values}
    try:
        for name, value in values.items():
            object.__setattr__(RULES, name, value)
        yield
    finally:
        for name, value in before.items():
            object.__setattr__(RULES, name, value)
