"""Every number that decides something in a diagnosis: what it decides, in which channel, and why it has its value.

The order is that of a diagnosis: what is compared, proposed, accepted, exchanged, dropped and named, the verdict, and
results beside it. Numerical tolerances, sizes of pictures, limits of memory and time, bandwidths of filters and
physical constants are not here: they stand where they are used.

A rule has a `reason` (a quantile, a level, an accuracy) or a `case` (the data for which it was needed), each as far as
it is known, and the commit that set its value. Modules read `RULES.tie` when they need it, so a diagnosis inside
`varied(tie=0.0)` shows what a rule does. docs/rules.md is the table of all.

Words: a "noise variance" is the unit of squared errors, a "noise" that of errors (one standard deviation). The "floor"
is the error that the right model would leave. An "error of form" is one of the model's laws, not of its parameters. A
"figure" is a number that summarises the depth or the light of a camera's pictures. "(0.5 before)" is an earlier value.
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
        name: its name in `RULES`.
        value: the number, or several of one kind.
        channel: the channel in which it decides something; `all` for more than one.
        decides: what it decides, with the unit.
        commit: the commit that set the value.
        reason: why it has this value; empty where none is known.
        case: the data or the case for which it was needed; empty where none is known.
        tried: what a diagnosis without it, or with another value, did (scripts/bench/rules.py); empty if not tried.
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
        "The same where a wrong start fades only by the observer, or by OSC's null-space control; and seconds that are "
        "left out after a loop was unstable.",
        reason="the observer's 8 rad/s leave under 1 in 1000 of it")
    runaway_speed: float = _rule(3.0, "joints", "47e115cb",
        "Multiple of its rated speed from which a joint's control loop counts as unstable.",
        reason="no loop that holds its arm reaches it")
    runaway_before: float = _rule(0.1, "joints", "47e115cb",
        "Seconds before such a speed that are left out.",
        reason="errors grow before they show")
    saturated_beyond: float = _rule(1.5, "joints", "fb73cacf",
        "Multiple of the greatest torque that the motion needed, beyond which a command counts as not delivered.",
        reason="saturated drives were asked for 3.2 times and more, most of the time (7 limits of two joints); with an "
        "even torque but no limit, by a payload, joints asked for 1.45 at most (75 recordings)")
    beyond_stop: float = _rule(0.05, "joints", "fb73cacf",
        "Angle (rad) beyond a stated stop from which the stop is left out of the model.",
        reason="no encoder's offset and no stop's give is more")
    posture: float = _rule(0.05, "joints", "24523092",
        "RMS angle error (rad) of a joint from which an OSC recording is compared in the measured posture.",
        reason="inertia and gravity differ by some per cent there")
    touch_after: float = _rule(0.5, "joints", "d380f188",
        "Seconds after a contact that joints do not judge.",
        reason="OSC's null-space control needs as long to remove its effect on the posture")
    touch_light: float = _rule(1.0, "joints", "d380f188",
        "Force (N) from which a measured contact acts on the model's arm.",
        reason="less hardly moves an arm under soft control")
    still_angle: float = _rule(1e-3, "joints", "66fd68e7",
        "Range (rad, m) of angles or goals up to which nothing moves.",
        case="in any 2 s some joint of a real KUKA LWR4+ or Panda moved by 0.48 rad and more")
    still_torque: float = _rule(0.1, "joints", "66fd68e7",
        "Range (N m) of commanded torque up to which nothing moves.")
    still_noise: float = _rule(10.0, "joints", "66fd68e7",
        "Range of a joint's readings, in stated noises, up to which it is at rest.",
        reason="the range of 10^6 normal readings is about 10 standard deviations")
    torque_repeats: float = _rule(0.02, "joints", "d3946098",
        "Share of a signal's spread: least noise of a torque, where none is stated; and difference of angles up to "
        "which two recordings count as runs of one motion.",
        reason="what differs so little between two runs adds no more noise than is assumed without them",
        case="two runs of a KUKA LWR4+ differ by 0.0008 of their motion, other motions by more than all of it")
    load_noise: float = _rule(0.2, "joints", "0b8fe262",
        "Noise of a servo's load reading as a share of its spread.",
        reason="an estimate from current or duty cycle is no sensor")
    grid_step: float = _rule(4.0, "joints", "8a3542a9",
        "Least step of an encoder, in noises, that is inferred from its readings.",
        reason="an estimated noise is never less than step / sqrt(12)")
    grid_off: float = _rule(0.05, "joints", "8f055d1b",
        "Share of a step by which a reading may lie off the grid.",
        reason="a log whose last digit is a tenth of a step rounds by as much")
    noise_quantile: float = _rule(0.9, "joints", "f10230da",
        "Quantile, over draws, of the error that noise, fed back by the controller, causes in the right model: its "
        "floor.",
        reason="one draw in ten exceeds it",
        case="OSC arms with the right model that were called unexplained")
    noise_quantile_coarse: float = _rule(0.5, "joints", "e07bb19d",
        "The same where encoders are coarse.",
        reason="the draws differ by where in a step the arm began; the other quantile's floor would hide effects")
    coarse: float = _rule(2.0, "joints", "e07bb19d",
        "Error of a reading, in noises, from which an encoder counts as coarse.",
        reason="the step is then over six noises, the range of plus and minus three standard deviations")
    noise_magnified: float = _rule(10.0, "joints", "671f1452",
        "Error of the right model by fed-back noise, in noise variances, from which no effect is looked for.",
        case="effects of micrometres named on an effect-free arm near a singular posture")
    loud: float = _rule(10.0, "joints", "7abebd9a",
        "Multiple of the greatest held-out squared error (of the noise at least) from which a fitted recording shows "
        "something that no held-out one does: before the search it judges too or is left out, after it nothing is "
        "identified.",
        case="a drive that saturates in two of three motions and not in the held-out one")
    contact_block: float = _rule(0.04, "contact", "65a197ce",
        "Seconds of a block, over which forces of contact are means.",
        reason="such a mean has little of a solver's chatter")
    block_read: float = _rule(0.5, "contact", "b4c55ada",
        "Share of a block's samples that must have a reading for it to count.",
        case="wrench samples that a force sensor lost")
    rest_least: float = _rule(0.3, "contact", "65a197ce",
        "Seconds at rest in free air that an episode must begin with.",
        reason="seven blocks, whose noise is then known to a third")
    rest_most: float = _rule(1.0, "contact", "65a197ce",
        "Seconds of that rest, at most, from which the sensor's zero is taken.",
        reason="in it a zero drifts by less than its noise: 0.02 N, if it drifts by `zero` in 10 s")
    rest_softest: float = _rule(2e3, "contact", "5af1f35e",
        "Change of force over displacement (N/m) on the way from rest, from which the hand rested in contact.",
        reason="rubber has 10 N/mm and more")
    rest_sigmas: float = _rule(3.0, "contact", "5af1f35e",
        "Standard deviations of the reading that count as no change of force there.",
        reason="three standard deviations")
    weight_towards: float = _rule(0.5, "contact", "bce7ef5c",
        "Cosine of the angle to the weight under which the wrench is refused.",
        reason="a tool's weight may differ in size, but not in direction")
    weight_times: float = _rule(4.0, "contact", "bce7ef5c",
        "Ratio of the force to the weight, or the inverse, from which the wrench is refused.",
        reason="a wrong unit is off by more")
    contact_far: float = _rule(4.0, "contact", "0319eca4",
        "Noise floors beyond which the square of a contact error counts linearly (25 before).",
        reason="1 in 16,000 normal errors is greater")
    contact_correlated: float = _rule(6.0, "contact", "65a197ce",
        "Consecutive blocks over which an error of form is the same.",
        reason="it lasts as long as a contact does")
    contact_lasting: float = _rule(14.0, "contact", "e9949f56",
        "Consecutive blocks over which an error of form biases a parameter in one direction.",
        reason="a visit to a phase of contact takes as long")
    contact_rough: float = _rule(5.0, "contact", "4cfd3ec2",
        "Change of the squared residual that a solver's chatter makes.",
        case="worlds 1e-3 of an effect apart differed by 5 to 15")
    chatter: float = _rule(3, "contact", "98b720e7",
        "Least gain of an effect, as a multiple of `contact_rough`.",
        reason="15 over 5, the most and the least of the changes seen")
    floor_form: tuple[float, ...] = _rule((0.02, 0.01, 0.04, 0.05, 2.0), "contact", "cb0b46b3",
        "Floor (N) by errors of form of the contact law: free air, press, slide, inside the goal, impact.",
        case="what the true model left on development cases")
    floor_share: tuple[float, ...] = _rule((0.002, 0.003, 0.007, 0.01, 0.03), "contact", "ef8d5bde",
        "The same as a share of the force of contact.",
        case="at 0.1 % of a press a stiff arm's give was named where nothing was hidden")
    floor_wedged: float = _rule(4.4, "contact", "8e245e45",
        "Addition to that share inside the goal, where a part wedges, over the squared sine of its tilt.",
        reason="0.1 mm of its roundness turns the hand by mrad")
    floor_loose: int = _rule(2, "contact", "cb9cd3d1",
        "Blocks before and after a slide that have the slide's floor.",
        reason="no model says when exactly a contact breaks loose")
    zero: float = _rule(0.2, "contact", "65a197ce",
        "Force (N) by which a sensor's zero differs from one start to another, and drifts over a recording.",
        reason="the sensor warms up")
    cross_talk: float = _rule(0.01, "contact", "d95395ee",
        "Share of each of the six components that appears in each other one.",
        reason="what calibration leaves")
    kinematics_place: float = _rule(2e-4, "contact", "9a0e906e",
        "Distance (m) by which forward kinematics may be off within a cell.",
        reason="twice what an arm repeats a pose to, for no calibration makes it as true",
        case="at half of it a soft grip was named where nothing was hidden")
    kinematics_turn: float = _rule(4e-4, "contact", "9a0e906e",
        "The same of orientations (rad).",
        case="the same")
    kinematics_far: float = _rule(0.02, "contact", "d95395ee",
        "Distance (m) over which that error changes.",
        reason="a strain-wave gear's error repeats twice a turn of its input: at 1:160 each 0.02 rad, 0.016 m at 0.8 m")
    bears_aside: float = _rule(0.15, "contact", "4a08f3e6",
        "Distance, in radii of its end, from a pressed part's axis to the centre of pressure.",
        reason="half of the 0.3 radii by which four points of a rim support a part less than the full circle")
    slide_across: float = _rule(0.1, "contact", "5f5e4870",
        "Share of a slide's drag that may act across the direction of motion.",
        reason="in the model every slide hops, and a tool whose mass is off its axis swings aside")
    torque_holds: float = _rule(1.0, "contact", "a91c3c0d",
        "Seconds over which friction in joint torques keeps its sign, where no force sensor is.",
        reason="a stroke of a motion takes about as long")
    noise_louder: float = _rule(1.15, "contact", "d95395ee",
        "Ratio to the stated noise from which a sensor counts as noisier than stated.",
        reason="stated figures are rounded")
    noise_sigmas: float = _rule(3.0, "contact", "d95395ee",
        "Standard errors by which its noise must exceed the stated one for that.",
        reason="three standard deviations")
    frames_least: int = _rule(6, "pictures", "367f443f",
        "Frames of a camera that a recording must have.",
        reason="fewer say nothing about views that were not fitted")
    frame_still: float = _rule(2e-4, "pictures", "7a1c05b5",
        "Angle (rad) by which joints may move between frames that count as repeats of one view.",
        reason="0.1 px of a picture 320 px wide at 0.3 m")
    edge_step: float = _rule(15.0, "pictures", "367f443f",
        "Least step of grey levels across an edge.",
        case="in 24 pictures in looks of the training world `S` 3 % of places inside surfaces have such a step and 94 "
        "% of borders; 11 and 95 % have one of 6 grey levels")
    edge_times: float = _rule(4.0, "pictures", "cb619a46",
        "Least step across an edge as a multiple of what noise alone gives.",
        reason="four standard deviations")
    edge_tukey: float = _rule(4.685, "pictures", "367f443f",
        "Distance, in scatters, beyond which an edge belongs to something else.",
        reason="Tukey's weights, 95 % efficient for normal errors")
    edge_shift: float = _rule(0.1, "pictures", "fbb7d3b1",
        "Shift (px) that light and shadow give to all edges that face one way, lie between two parts or at one place.",
        case="measured on rendered pictures in looks of the training world `S` against the borders of the model")
    edge_shift_here: float = _rule(0.05, "pictures", "fbb7d3b1",
        "The same of two parts in one picture.",
        case="the same")
    edge_place: float = _rule(0.02, "pictures", "4b61a492",
        "Length (m) on a part over which the shading shifts an edge alike in all frames.",
        case="a camera 20 mm off: without it x is 20.06 [20.01, 20.12] mm and 0.124 px are left, with it 19.99 [19.93, "
        "20.05] and 0.095")
    thing_known: tuple[float, float] = _rule((1e-3, 5e-3), "pictures", "367f443f",
        "Accuracy (m, rad) to which fixture and grip are known.",
        reason="taught with an arm that errs by 1 mm (`posture_frame`), by two points 0.2 m apart")
    posture_frame: float = _rule(1.25e-3, "pictures", "7a1c05b5",
        "Angle (rad) that a joint may be off by in a frame.",
        reason="1 mm at 0.8 m, of an arm that nobody calibrated (Slamani, Nubiola and Bonev, Industrial Robot 39(1))")
    robot_half: float = _rule(0.5, "pictures", "36f8b40b",
        "Share of the arm's errors that a free read-out time may leave, for it to be the explanation.",
        reason="three quarters of their variance are then no arm's",
        case="a read-out time that was taken for the arm's errors")
    field_gain: float = _rule(2.7, "pictures", "6ff9609c",
        "Log likelihood that a field of shifts over the image must gain.",
        reason="1 %, half of chi squared (Self and Liang 1987)",
        case="a smear on the lens beside errors of the joints")
    astray: float = _rule(0.25, "pictures", "367f443f",
        "Share of borders without an edge within half a pixel, from which the camera is searched far from its pose.",
        case="a camera 5 mm and 2 % of its focal length off: at 0.5 the alignment takes wrong edges, and 0.69 px are "
        "left for 0.096")
    figure_depth: float = _rule(4e-3, "pictures", "7a1c05b5",
        "Difference of depth between good cameras, as a share of distance: in the mean, and from the middle of the "
        "image to 45 degrees off it.",
        reason="a D400's 2 % is a limit for all of them")
    figure_repeats: float = _rule(0.25, "pictures", "2511046a",
        "Repeatability of a figure, as a share of its difference between good cameras; an effect is tried, and is "
        "excited, if a typical size changes a figure by more.",
        reason="a calibration of depth repeats to 0.1 % of the distance, a quarter of `figure_depth`")
    figure_missing: float = _rule(0.02, "pictures", "2511046a",
        "The share of missing readings that good cameras differ by.",
        reason="a D435 loses up to 2 % in spots (worlds/sensors/d435.yaml)")
    figure_light: float = _rule(1 / 3, "pictures", "2511046a",
        "The same of the level of light, and of its fall-off to the corners, in octaves.",
        reason="a third of a stop, the step of a camera's exposure")
    figure_colour: float = _rule(0.15, "pictures", "fbb7d3b1",
        "The same of red and blue, in octaves.",
        reason="daylight of 5500 and of 6000 K differ by 0.14 octaves of blue")
    figure_softness: float = _rule(0.35, "pictures", "fbb7d3b1",
        "The same of the softness of borders, in px^2.",
        reason="bilinear interpolation of a Bayer pattern spreads grey by 0.35 px^2")
    figure_exposure: float = _rule(1 / 60, "pictures", "2511046a",
        "Exposure (s) of a good camera, by which moving borders are soft.",
        reason="a frame at 60 Hz")
    figure_noise: float = _rule(0.35, "pictures", "fbb7d3b1",
        "The noise of depth and of colour that good cameras differ by, on a logarithmic scale.",
        reason="twice the variance")
    flights_least: int = _rule(20, "tosses", "1eb50084",
        "Windows of free flight from which the noise floor is taken.",
        reason="three coordinates each: the median error of 60 readings scatters by 15 %")
    toss_near: float = _rule(3e-3, "tosses", "1eb50084",
        "Distance (m) to the table within which an object may touch it.",
        case="60 real tosses of a cube: friction 0.201 with 1, 3 and 10 mm")
    toss_far: float = _rule(8.0, "tosses", "1eb50084",
        "Noise floors beyond which the square of an error counts linearly.",
        case="60 real tosses of a cube: friction 0.198, 0.201 and 0.211 with 4, 8 and 16, in [0.17, 0.25] by each")
    block: float = _rule(0.25, "all", "2fcabec5",
        "Seconds of a block, the unit of the tests over held-out recordings.",
        reason="neighbouring blocks are nearly independent",
        case="their gains correlate by 0.79, 0.55, 0.28 and 0.33 for blocks of 0.05, 0.1, 0.25 and 0.5 s (medians of "
        "25 arms)")
    folds: int = _rule(4, "joints", "b805ac3c",
        "Parts of the only fitted recording that predict one another; and of time or range, over which an effect must "
        "be constant.",
        reason="from four on the number hardly matters",
        case="in 2, 3, 4, 8 and 16 parts ten parameters leave 5.2, 3.8, 3.7, 3.8 and 3.7 noise variances; up to three "
        "parameters of five other recordings 0.08 more or less at most")
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
        "Share of a joint's missing torque that counts as error of form in the first proposal.",
        reason="no law is exact")
    first_typical: float = _rule(3.0, "joints", "ecf3a9b7",
        "Width of the prior of a size in the first proposal, in typical sizes.",
        reason="so wide that the data decide",
        case="at 1.5 and 6 the same effects of 1 % or more in 35 and 34 of 35 cases of seed 4711 (e6f7533f)")
    first_shape: float = _rule(0.25, "joints", "ecf3a9b7",
        "Width of the prior of a shape in the first proposal, as a share of its range.",
        reason="so wide that the data decide",
        case="at half and at double the same effects in 35 of 35 cases of seed 4711 (e6f7533f)")
    first_tie: float = _rule(3.0, "joints", "ecf3a9b7",
        "Nats within which another effect is as likely in the first proposal.",
        reason="odds of 20 to 1")
    looked: int = _rule(8, "joints", "9e47cadb",
        "Best candidates of a linear model on the fitted recordings whose error on others is computed, at each move.",
        reason="errors on others choose among few: among many, chance does",
        case="a vibration, which no effect is: with all that raise the evidence, 45 moves of the first proposal, with "
        "8 none; at a torque limit 1.4 times the error",
        tried="12, 8 and 3 in place of 6 in the first proposal: the same effects of 1 % or more in 33, 34 and 34 of 35 "
        "cases of seed 4711 (e6f7533f)")
    promise: float = _rule(0.3, "all", "1a2442b3",
        "Share of the gain that a step or rival needs, from which a candidate's predicted gain is enough for a fit.",
        reason="the screen is linear, so its predicted gains may be too small")
    fitted: int = _rule(5, "joints", "1a2442b3",
        "Candidates that are fitted at a step, and rivals of an effect, at most.",
        case="5 and 7 in 8 cases of seed 301131: the same effects and verdicts")
    contact_fitted: int = _rule(3, "contact", "65a197ce",
        "Effects that are fitted at a step, alone and in pairs, and in the place of an effect.",
        reason="the two that any case of hidden_contact hides, and one that imitates them")
    edge: float = _rule(0.005, "all", "45b9c56e",
        "Share of a range from its bound within which a value stands at the bound.",
        reason="where the optimum lies beyond a bound, bounded least squares ends this near it in 99 % of 2000 linear "
        "problems")
    several_link: float = _rule(0.1, "joints", "fbd72ba7",
        "Share of the error that a link's mass or centre, or a payload, must remove in the linear model (others: "
        "`gain`).",
        reason="otherwise many links come in that cancel one another")
    several_likelier: float = _rule(0.8, "joints", "e3f41922",
        "Share of an effect's gain from which one of those in its `likelier` is taken in its place.",
        case="a payload that was added as masses of links beside other effects (0.9 before)")
    several_better: float = _rule(0.995, "joints", "9e47cadb",
        "Share of the remaining error that an exchange in the linear model may leave at most.",
        case="two biases accepted for a tilted base")
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
        "Greatest number of effects that a search adds.",
        reason="every joint has friction")
    effects_few: int = _rule(6, "all", "65a197ce",
        "Greatest number of effects that a search of contact, or of borders in pictures, adds.",
        case="three times the two that any case of hidden_contact or hidden_camera hides")
    later: float = _rule(0.001, "all", "f15b2aa2",
        "Share of the error that earlier effects typically removed, that a later one must remove.",
        reason="no model is exact",
        tried="off, no change on coulomb_friction/joint4/small of seed 4711 (b8ca1027)")
    discoveries: float = _rule(0.01, "all", "b805ac3c",
        "Rate of false discoveries over all places that were screened.",
        reason="Benjamini and Hochberg, 1 %")
    large: float = _rule(0.4, "all", "e3f41922",
        "Removed share of the held-out squared error from which the tests over blocks need less significance.",
        reason="a fit of other recordings hardly removes as much by chance",
        case="a torque limit, which acts at times (0.5 in 3fbb93d7)",
        tried="off, no change on coulomb_friction/joint4/small of seed 4711 (b8ca1027)")
    level: float = _rule(0.05, "all", "b805ac3c",
        "Level of a test of one effect: in the held-out recordings alone, over blocks where the gain is `large`, and "
        "of what stays once others were added.",
        reason="5 %, one-sided")
    held_out_large: float = _rule(1.0, "all", "e3f41922",
        "Standard errors that a gain needs in the held-out recordings alone where it is `large`.",
        reason="a recording of 5 s has twenty blocks, and such a gain may lie in few")
    shift_px: float = _rule(0.2, "pictures", "6cd6d11d",
        "Least shift of the borders (px): by an effect, by what is left, or between fits to two halves of the views.",
        reason="looks, and errors of form of edges, shift them less")
    moving_px: float = _rule(0.12, "pictures", "6cd6d11d",
        "The same of a delay or a rolling shutter.",
        reason="a look makes no shift that depends on motion")
    views_apart: float = _rule(0.5, "pictures", "6cd6d11d",
        "Share of an effect's shift by which that of the held-out recording, fitted alone, may differ.",
        reason="cross-validation, as in mrcal")
    contact_level: float = _rule(0.01, "contact", "8e245e45",
        "Chance that any effect of the library passes although none is there.",
        reason="1 %, Bonferroni over the library; twice that one-sided on the held-out recordings")
    contact_alike: float = _rule(0.03, "contact", "d1d3f51c",
        "Share of the error that an effect removes, within which a rival is equal.",
        reason="contact laws are wrong by as much of a force")
    form_beside: float = _rule(0.1, "contact", "e39a6576",
        "Share of the remaining error of form that an effect beside others must remove.",
        reason="no contact law is exact")
    refinement: float = _rule(0.03, "joints", "54ffd752",
        "Share of the error that an effect removed, that one of the same kind beside it must remove.",
        reason="no model of friction is exact")
    clear_of_angle: float = _rule(0.2, "joints", "82e9c37c",
        "Removed share of the held-out error from which a torque that depends on the angle alone is no mere refinement "
        "of another effect (others: `alone`).",
        reason="no error of form of friction leaves such a torque")
    alone: float = _rule(0.8, "all", "954b27c7",
        "Removed share of the held-out error from which one effect is taken before several, and is no mere refinement "
        "of one of the same kind.",
        case="the demo's arm: several at a time named effects that were not there",
        tried="off, no change on coulomb_friction/joint4/small of seed 4711 (b8ca1027)")
    tie: float = _rule(0.03, "all", "2fcabec5",
        "Share of the error, or of the best predicted gain, within which candidates are equals.",
        tried="off, no change on coulomb_friction/joint4/small of seed 4711 (b8ca1027)")
    tie_room: float = _rule(0.3, "all", "2fcabec5",
        "Remaining error, in noise variances, that is added when candidates are compared near the noise floor.",
        reason="times `tie` a hundredth of the noise, by which the mean square of 5 s of seven joints at 500 Hz "
        "scatters",
        tried="off, no change on coulomb_friction/joint4/small of seed 4711 (b8ca1027)")
    tie_sigma: float = _rule(2.0, "all", "2fcabec5",
        "Standard errors under which two held-out errors are equal by chance; a member of a group must gain more.",
        reason="2.3 %, one-sided")
    correlated: float = _rule(0.9, "all", "e3bdc84a",
        "Correlation of two estimates from which neither effect is named for sure, and candidates with it come last.",
        case="a mass more in one link and less in the next: each is needed beside the other")
    # fmt: on


@dataclass(frozen=True)
class Exchanged:
    """What replaces an effect, and which rivals are fitted."""

    # fmt: off
    exchange: float = _rule(0.01, "all", "c6d6e56d",
        "Share of the held-out error, and in a search of the fitted one, that an exchange of effects must remove.",
        case="effects at a bound in place of others")
    decisive: float = _rule(0.5, "joints", "3fbb93d7",
        "Share of the remaining error that a richer effect in place of a simple one must remove.",
        case="gear play that was taken for a rotor's inertia")
    richer_sigma: float = _rule(3.0, "all", "ea475dcf",
        "Standard errors by which a richer effect must be better to be a rival.",
        reason="0.1 %: it contains the chosen one, so it is never worse")
    law_scales: tuple[float, ...] = _rule((1.0, 3.0), "joints", "64d409e6",
        "Multiples of a guess at which a richer effect starts.",
        case="gear play behind a light rotor")
    law_fitted: int = _rule(2, "joints", "64d409e6",
        "Starts of each richer effect that are fitted.",
        case="the same")
    rivals_full: int = _rule(3, "joints", "65a197ce",
        "Effects up to which the whole library is screened for rivals of each.")
    # fmt: on


@dataclass(frozen=True)
class Dropped:
    """Removal of effects that become superfluous after others were added."""

    # fmt: off
    drop_rise: float = _rule(0.05, "joints", "45b9c56e",
        "Share by which the held-out error may rise when effects are removed.",
        case="deletions after which the held-out error rose, since the linear model did not predict it")
    drop_chance: float = _rule(1.0, "joints", "b04a4732",
        "Standard errors by which it may rise when only the fitted recordings call an effect useless.",
        reason="the one-standard-error rule (Breiman et al., Classification and Regression Trees, 1984)")
    sparse_level: float = _rule(0.05, "contact", "99c33128",
        "Chance that a parameter that is not null is taken for null.",
        reason="5 %")
    # fmt: on


@dataclass(frozen=True)
class Named:
    """Which effects of a model may be named, and which are tentative."""

    # fmt: off
    part_level: float = _rule(0.05, "pictures", "7a1c05b5",
        "Level of the test that parts of an effect (scale, offset, tilt of depth) are absent.",
        reason="Wald, 5 %")
    name_costs: float = _rule(0.3, "joints", "9e47cadb",
        "Share of the remaining error by which the error must rise without a named effect, given any other candidate.",
        case="biases that replaced a tilted base")
    name_costs_far: float = _rule(1.0, "joints", "0b929084",
        "The same where the remaining error is more than `far`.",
        reason="an effect that removes less than remains may compensate a part of what is missing")
    name_alike: float = _rule(0.7, "joints", "de0de97d",
        "Rise of the error by an effect's removal where another is in the model, as a share of the rise where it is "
        "not, below which the two are alike.",
        case="a wrong effect that fits one motion better than the true one and is worse on another")
    name_class: int = _rule(3, "joints", "9e47cadb",
        "Proven rivals beyond which an effect is tentative; and greatest number of its rivals that the linear model "
        "proposes, to be fitted.",
        reason="a name of many possible ones says nothing")
    law: float = _rule(2.0, "contact", "5f5e4870",
        "Multiple of the nominal stiffness or damping of a contact up to which an error of form explains it.",
        reason="by Hunt and Crossley (1975), restitution falls between 20 and 70 mm/s as if damping doubled")
    repeats: float = _rule(0.5, "contact", "4a08f3e6",
        "Share of `kinematics_place` to which an arm repeats a pose; no smaller error of a pose is named.",
        reason="0.1 mm, a KUKA iiwa's data sheet")
    interval: float = _rule(3.84, "contact", "cb9cd3d1",
        "Rise of the squared residual at the ends of an interval; models that differ by less than `contact_lasting` "
        "times it are equal.",
        reason="95 % of chi squared, one degree of freedom",
        case="errors of form made a gain better by 36 and 50 than the heavier tool that was there (presses)")
    interval_less: float = _rule(0.5, "contact", "0bbdbdd4",
        "Least rise above the fit's residual at the ends of an interval, as a share of the full rise, where the "
        "profile falls below that residual.",
        case="intervals without a width")
    parts_remove: float = _rule(0.3, "joints", "858007e9",
        "Share of a joint's remaining error that a value for each part removes, from which an effect is not constant.",
        case="friction that falls while a gear warms up, or sits at one angle alone")
    parts_apart: float = _rule(0.5, "joints", "858007e9",
        "Share of an effect's value by which those of the parts must differ for that.",
        case="the same")
    # fmt: on


@dataclass(frozen=True)
class Concluded:
    """The verdict."""

    # fmt: off
    at_floor: float = _rule(1.25, "joints", "1a2442b3",
        "Noise variances of held-out error at which nothing is left to look for (1.2 before).",
        case="the right model of another simulator's arms left 0.99 to 1.18 in 8 of 9 held-out recordings under "
        "position or torque control, 1.27 in the ninth")
    adequate: float = _rule(1.6, "all", "2fcabec5",
        "Noise variances of held-out error up to which a model stands at the noise floor.",
        case="the right model of another simulator's arms left up to 1.38 in 18 fits and tests under position or "
        "torque control, 1.9 and 2.4 under OSC, whose fed-back noise the floor counts")
    explained: float = _rule(0.97, "all", "2fcabec5",
        "Share of the held-out excess over noise that an identified model must explain.",
        case="the true effects explain 0.992 and more in 19 arms; beside an effect that no library has, 0.946, 0.998 "
        "and 0.9985 in three")
    far: float = _rule(100.0, "all", "25a39308",
        "Noise variances in any kind of channel above which no model is identified.",
        reason="ten times the noise",
        case="a model so wrong that an explanation of 97 % of its error left 25 times the noise")
    inertial: float = _rule(1.25, "joints", "f121f501",
        "Multiple of the error that least squares of all inertial parameters leave, up to which a model is identified.",
        reason="no rigid arm with plain friction could remove a smaller remainder")
    phase_spread: float = _rule(2.6, "contact", "8e245e45",
        "Standard deviations by which the mean of few squared errors may lie above the floor's variance: of the blocks "
        "of a phase, or of blows.",
        reason="0.5 %, one-sided")
    blow_parted: float = _rule(0.08, "contact", "5f5e4870",
        "Share of a blow's peak force below which the tool is in flight.",
        case="at 0.2 a part that presses on counted as flying, for 50 ms; at a touch alone flights of 6 ms were lost")
    blow_brush: float = _rule(5.0, "contact", "5f5e4870",
        "Multiple of the threshold of a touch up to which a peak is no blow.",
        case="15 brushes peaked at 2.5 times it at most, 48 blows at 12 times and more (hidden_contact)")
    blow_form: tuple[float, float] = _rule((0.15, 0.25), "contact", "5f5e4870",
        "Shares of a blow's impulse and flight by which the right model is off.",
        case="at 0.2 of both a damping was named, identified, where the tool's centre was 8 mm aside (com/large of "
        "hidden_contact, seed 301202)")
    blow_least: tuple[float, float] = _rule((0.01, 0.004), "contact", "5f5e4870",
        "Least errors of a blow's impulse (N s) and flight (s).",
        case="the same at a touch over two samples")
    peak_share: float = _rule(0.25, "contact", "6446e633",
        "Share of the measured peak force by which that of a simulated insertion may differ.",
        reason="paths diverge where contacts begin and end")
    moved_share: float = _rule(0.03, "pictures", "2f00f054",
        "Predicted share of the remainder that makes the verdict unexplained where the shift is `moved_px` or more.",
        case="a moved part, most of whose edges are no longer near it; a share of trusted edges alone needs no such "
        "rule, but a cell without a fault became unexplained (none/3/1mm of hidden_camera, seed 301231)")
    moved_px: float = _rule(1.0, "pictures", "2f00f054",
        "Shift (px) that only a moved part makes.",
        reason="several times the shift in pictures without such a fault")
    left_points: int = _rule(25, "pictures", "2511046a",
        "Least number of points, fitted and held out, from which a shift is estimated.",
        reason="of edges that scatter by half a pixel their mean errs by 0.1 px, half of `shift_px`")
    moved_sigma: float = _rule(3.0, "pictures", "97667a06",
        "Multiple of `thing_known` by which a thing's place may differ in the held-out recordings.",
        reason="three standard deviations",
        case="a fixture that was moved between the recordings")
    halves_sigma: float = _rule(2.0, "pictures", "367f443f",
        "Standard errors by which fits to two halves of the views may differ.",
        reason="2.3 %, by Student's t of few views")
    lost: float = _rule(0.5, "pictures", "367f443f",
        "Share of predicted borders without an edge from which the pictures count as those of another cell.",
        reason="robust weights need a majority")
    depends: float = _rule(0.15, "all", "2fcabec5",
        "Share of the missing torque, or shift, that an input must predict to be reported.",
        case="of effects that no library has, a vibration, a gear that warms up and a base that sways had 0.36 and "
        "more at their input (11 arms); a rough spot, which none predicts, had 0.23, 0.11, 0.06 and 0.06, nominal arms "
        "0.04 at most")
    # fmt: on


@dataclass(frozen=True)
class Told:
    """Results beside the verdict: minimum detectable sizes, the next motion, whether a robot changed."""

    # fmt: off
    power: float = _rule(0.9, "all", "43dfe918",
        "Probability with which an effect of the least visible size is found.",
        reason="nine times in ten")
    next_sigma: float = _rule(3.0, "all", "0df63f4c",
        "Standard deviations between two models' predictions below which no next motion is proposed.",
        reason="three standard deviations")
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
    """Give rules other values while the block lasts."""
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
