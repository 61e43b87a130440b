"""Commands on models: compare, diagnose, fit, and change them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from vispeg.cli.command import Call, Option, command
from vispeg.core.errors import UserError
from vispeg.core.interrupt import goes_on

SEVERAL = Option(repeats=True)
RECORDINGS = Option("recording", default=(), repeats=True)


@command("vispeg.api.compare:compare", "model", recordings=RECORDINGS)
def compare(call: Call, out: Path, overwrite: bool = False) -> None:
    """Compare a model with recordings, without fitting.

    Shows how large the error is, at which joint, and when. Writes OUT/compare.json, OUT/evidence.npz and
    OUT/report.html.

    Example:
        vispeg compare iiwa14 --recording rig-a --recording rig-b --out compared
        vispeg compare found/model.yaml --recording rig-d --out compared

    Args:
        out: folder for the results.
        overwrite: replace `out` if it exists.
    """
    from vispeg.api.inputs import model_files
    from vispeg.cli.progress import reading_bars
    from vispeg.report.text.terminal import report_line

    inputs = (*model_files(call.model), *call.recordings)
    result = call.saved(out, overwrite, "comparison", inputs, reading=reading_bars(call.output.quiet))
    call.give(result, report_line(out))


@command(
    "vispeg.api.diagnose:diagnose",
    "model",
    recordings=RECORDINGS,
    validate=SEVERAL,
    baseline=SEVERAL,
    policies=Option("policy", repeats=True),
    cell=Option("world"),
    part=None,
)
@goes_on()
def diagnose(call: Call, out: Path, overwrite: bool = False) -> None:
    """Name the effects that a model lacks and add them to it.

    An effect is accepted if the error falls on held-out recordings. Writes OUT/diagnosis.json, OUT/report.html,
    OUT/model.yaml (the corrected model) and the next motion to record. Exits 0 with a verdict: adequate, identified,
    ambiguous or unexplained. Repeat the command to continue a stopped diagnosis; its steps are in OUT.part.

    `--baseline` finds what has changed since those recordings, such as a payload or a repair. Effects that the model
    lacked before are named first and added to it; `effects` then holds only the change.

    `--policy` measures what the remaining error costs a policy. It plays with the identified model, and again with each
    value drawn from its interval and the unexplained torque added. The difference is in percentage points of success.

    Recordings may hold joint torques, pictures and, in a cell, a wrench. Each of these channels (joints, contact,
    pictures) is diagnosed separately, and again if another one has named an effect that it needs. One page has all
    verdicts. Pictures are compared with a cell, or with the objects beside the arm in the robot's own MJCF.

    Example:
        vispeg diagnose iiwa14 --recording rig-a rig-b --validate rig-c --out found
        vispeg diagnose iiwa14 --recording rig-a --hold-out 0.3 --out found
        vispeg diagnose iiwa14 --recording rig-a --recording rig-b --validate rig-c --policy runs/best --out found
        vispeg diagnose iiwa14 --baseline empty-a empty-b --recording loaded-a --validate loaded-b --out change

    Args:
        out: folder for the results.
        overwrite: replace `out` if it exists.
    """
    from vispeg.api.inputs import model_files
    from vispeg.cli.progress import reading_bars, stages
    from vispeg.report.text.proposal import likely
    from vispeg.report.text.terminal import written_lines

    inputs = (*model_files(call.model), *call.recordings, *call.validate, *call.baseline)
    with stages(call.output.quiet) as say:
        result = call.saved(
            out,
            overwrite,
            "diagnosis",
            inputs,
            say=say,
            likely=lambda proposal: say.keep(likely(proposal)),
            reading=reading_bars(call.output.quiet),
            part=Path(f"{out.resolve()}.part"),
        )
    call.give(result, *written_lines(result.record, out))


@command(
    "vispeg.api.fit:fit",
    "model",
    recordings=RECORDINGS,
    validate=SEVERAL,
    part=None,
)
@goes_on("--resume")
def fit(call: Call, out: Path, protocol: Literal["effects", "paper"] = "effects", overwrite: bool = False) -> None:
    """Fit the parameters of named effects, with 95 % intervals.

    An effect is EFFECT:WHERE; WHERE `all` fits one value for all places, `each` one for each. Without --effects, those
    of the model file are fitted. Writes OUT/fit.json, OUT/model.yaml, OUT/report.html and, for joints,
    OUT/evidence.npz. --resume continues a stopped fit.

    `--protocol paper` fits link masses, joint damping and the direction of gravity by CMA-ES to the flange's path in
    short sub-trajectories of one recording under operational space control (`vispeg record --motion osc`), with
    intervals; parameters that the path does not determine are named.

    Example:
        vispeg fit iiwa14 --recording rig-a --recording rig-b --validate rig-c \\
            --effects coulomb_friction:joint4 payload:flange --out fitted
        vispeg fit model.yaml --recording rig-a --effects viscous_friction:each --starts 4 --out fitted
        vispeg fit iiwa14 --protocol paper --recording osc-run --out fitted

    Args:
        out: folder for the results.
        protocol: fit named effects to recordings, or the paper's protocol (120 generations of CMA-ES by default).
        overwrite: replace `out` if it exists.
    """
    from vispeg.api.inputs import model_files
    from vispeg.cli.progress import reading_bars
    from vispeg.core.files import reserved

    inputs = (*model_files(call.model), *call.recordings, *call.validate)
    options = {"part": Path(f"{out.resolve()}.part"), "reading": reading_bars(call.output.quiet)}
    with reserved(out, overwrite, holds="fit", inputs=inputs):
        result = _by_paper(call, options) if protocol == "paper" else _by_effects(call, options)
        result.save(out, overwrite=overwrite)
    pictures = (f"picture: {path}" for path in sorted(out.glob("paths-*.png")))
    call.give(result, f"model: {out / 'model.yaml'}", *pictures)


def _by_effects(call: Call, options: dict[str, Any]) -> Any:
    from vispeg.cli.progress import following
    from vispeg.identify.calibrate import ITERATIONS

    steps = ITERATIONS if call.iterations is None else call.iterations
    with following(call.starts, steps, call.output.quiet) as watch:
        return call(watch=watch, **options)


def _by_paper(call: Call, options: dict[str, Any]) -> Any:
    from vispeg.api.fit_paper import fit_paper
    from vispeg.cli.progress import generations
    from vispeg.identify.paper.protocol import GENERATIONS

    for flag in ("--effects", "--starts", "--method", "--channels", "--seconds"):
        if flag in call.changed:
            raise UserError("is not for the paper's protocol", key=flag, expected="--protocol effects")
    if len(call.recordings) != 1:
        got = len(call.recordings)
        raise UserError("the paper's protocol fits one recording", key="--recording", expected=1, got=got)
    if call.engine != "local":
        raise UserError("the paper's protocol runs on this machine", key="--engine", expected="local", got=call.engine)
    steps = GENERATIONS if call.iterations is None else call.iterations
    options |= {key: call.given[key] for key in ("seed", "threads", "resume")}
    with generations(steps, call.output.quiet) as watch:
        return fit_paper(call.model, call.recordings[0], call.validate, iterations=steps, watch=watch, **options)


@command("vispeg.api.library.catalogue:effects", "name")
def effects(call: Call, where: str | None = None, out: Path | None = None, overwrite: bool = False) -> None:
    """List the effects that a model can have, or explain one.

    `--out` draws a picture: what the effect, at its typical size, changes in one joint under position control, or in
    the pictures of the cell's cameras.

    Example:
        vispeg effects
        vispeg effects stribeck_friction
        vispeg effects stribeck_friction --where joint2 --out pictures

    Args:
        where: place of the effect in the picture: a joint, a link, flange, base, all.
        out: folder for the picture, effect-NAME.png or, with a stated place, effect-NAME-PLACE.png; default: none.
        overwrite: replace the picture if it exists.
    """
    from vispeg.report.text.catalogue import describe, print_catalogue, print_effect

    for flag in ("--family", "--search"):
        if flag in call.changed and call.name is not None:
            raise UserError("is about a list of effects", key=flag, expected="no NAME beside it")
    for flag, value in (("--where", where), ("--out", out)):
        if value is not None and (call.name is None or call.output.json):
            raise UserError("is about the picture of one effect", key=flag, expected="NAME, and no --json")
    if where is not None and out is None:
        raise UserError("says where the picture puts the effect", key="--where", expected="--out FOLDER beside it")
    chosen = call()
    if call.output.json:
        call.output.give({"effects": [describe(kind, model) for kind, model in chosen]}, [])
    elif call.name is None:
        print_catalogue([kind for kind, _ in chosen], [model for _, model in chosen])
    else:
        from vispeg.api.library.effect_picture import draw_effect

        options = {"where": where, "robot": call.robot, "overwrite": overwrite}
        drawn = None if out is None else draw_effect(call.name, out, **options).line
        print_effect(*chosen[0])
        if drawn is not None:
            print(drawn)


@command()
def robots(call: Call, family: str | None = None, search: str | None = None) -> None:
    """List the arms that have a name, and which of them are installed.

    Any other arm is named by the path of its MJCF or URDF. Folders of Menagerie, and FOLDER/ENTRY, are names too. An
    arm marked `downloads` is downloaded when it is first used.

    Example:
        vispeg robots
        vispeg diagnose so101 --recording log-a log-b --validate log-c --out found

    Args:
        family: only arms of this kind: built in, here, downloads or not here.
        search: only arms with this text in name or description.
    """
    from vispeg.api.library.catalogue import robots
    from vispeg.cli.listing import show
    from vispeg.robots.menagerie import ABSENT, HOW

    entries = robots()
    absent = any(entry.family == ABSENT for entry in entries)
    show("robots", entries, "is", family, search, call.output, f"what is not here needs {HOW}" if absent else "")


@command("vispeg.api.add:add", "model", "name", "where", name=Option("effect"), settings=Option("set"))
def add(call: Call) -> None:
    """Add an effect or a measurement to a model file.

    An effect that the model has gets the values of --set; its other parameters stay. A new effect without --set has its
    typical size; with --set, its other parameters are null. MODEL is replaced only if --out names it, with --overwrite.

    Example:
        vispeg add iiwa14 coulomb_friction joint4 --set torque=1.2 --out model.yaml
        vispeg add model.yaml payload flange --set mass=0.6 z=0.07 --out model2.yaml
        vispeg add model.yaml joint4/measurement.yaml --out model2.yaml
    """
    call.give(call())


@command("vispeg.report.build:write_report", "out")
def report(call: Call) -> None:
    """Rebuild the HTML report of a finished result.

    Example:
        vispeg report out/rig-a --overwrite
    """
    from vispeg.report.record import load_record
    from vispeg.report.text import words

    path = call()
    values = load_record(call.out).values
    headline = words.verdict(values) or words.fall(values)
    call.output.give({"report": str(path), "headline": headline}, [headline, str(path)])
