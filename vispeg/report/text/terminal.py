"""The short tables and summaries that the command line prints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any

from vispeg.report.drawings.ladder import ladder_rows
from vispeg.report.record import Record, label, params_of, rows
from vispeg.report.sections.channels import channel_row
from vispeg.report.sections.found import correlations, effect_rows, share, without
from vispeg.report.text import camera_words, contact_words, unseen, words
from vispeg.report.text.quantities import fold, interval, number, quantity
from vispeg.report.text.summary import Block, Line
from vispeg.report.text.tables import Column, Sheet

WIDE = 34  # characters of a model's name that leave room for three columns of errors in 80


def ladder_table(diagnosis: Mapping[str, Any]) -> Sheet:
    """Return a table of models with errors on fitted and held-out recordings, the latter also in noise floors."""
    columns = [Column("Model"), *(Column(head, right=True) for head in ("Fitted", "Held out", "× floor"))]
    models = ladder_rows(_record(diagnosis))
    return Sheet(columns, [[_lines(row["model"]), row["fit"], row["heldout"], row["floor"] or "–"] for row in models])


def _lines(model: str) -> str:
    """Return a model's name; if too long for one line, with each of its effects on a separate line."""
    return model if len(model) <= WIDE else model.replace(" + ", "\n+ ")


def effects_table(diagnosis: Mapping[str, Any]) -> Sheet:
    """Return a table of effects: parameters with values, 95 % intervals and units, certainty, and values at a bound.

    A fit has no column for certainty, because the user chose its effects.
    """
    effects = effect_rows(_record(diagnosis))
    bound, sure = any(row["bound"] for row in effects), bool(diagnosis.get("verdict"))
    columns = [Column("Effect"), Column("Parameter"), Column("Value", right=True), Column("95 % interval")]
    columns += [Column("Unit"), *([Column("Certainty")] if sure else []), *([Column("Bound")] if bound else [])]
    cells = []
    for row in effects:
        line = [row["effect"], row["param"], row["value"], row["interval"] or "–", row["unit"]]
        cells.append(line + ([row["sure"]] if sure else []) + ([row["bound"]] if bound else []))
    return Sheet(columns, cells, keys=2, narrow=_narrow(effects, diagnosis))


def _narrow(effects: Sequence[Mapping[str, str]], diagnosis: Mapping[str, Any]) -> Sheet:
    """Return the rows of an effects table in few columns, value and unit in one.

    An effect with one parameter takes one line; of others the parameters stand below it.
    """
    placed, cells = {label(e): e for e in rows(diagnosis, "effects")}, list[list[str]]()
    for name, each in groupby(effects, key=itemgetter("effect")):
        params = [*each]
        certainty = params[0]["sure"] if diagnosis.get("verdict") else ""
        alone = len(params_of(placed[name])) <= 1
        if not alone:
            cells.append([name, "", "", certainty])
        for row in params:
            head, remark = f"  {row['param']}", row["bound"]
            if alone:
                head, remark = name, "\n".join(filter(None, (certainty, row["bound"])))
            cells.append([head, f"{row['value']} {row['unit']}".strip(), row["interval"] or "–", remark])
    columns = [Column("Effect"), Column("Value", right=True), Column("95 % interval")]
    columns += [Column("Certainty")] if any(remark for *_, remark in cells) else []
    return Sheet(columns, [row[: len(columns)] for row in cells])


def shares_table(diagnosis: Mapping[str, Any]) -> Sheet | None:
    """Return a table of effects: what each explains, and the error without it; None if the record does not say."""
    cells = [[label(e), share(e) or "–", without(e) or "–"] for e in rows(diagnosis, "effects")]
    columns = [Column("Effect"), Column("Explains"), Column("Error without it")]
    return Sheet(columns, cells) if any(row[1:] != ["–", "–"] for row in cells) else None


def restarts_table(diagnosis: Mapping[str, Any]) -> Sheet:
    """Return a table for a tossed object: each parameter as determined from windows of each length."""
    columns = [
        Column("Window"),
        Column("Parameter"),
        Column("Best", right=True),
        Column("95 % interval"),
        Column("Determined"),
    ]
    cells = []
    for row in rows(diagnosis, "restarts"):
        for p in rows(row, "parameters"):
            value, span = interval(p.get("best"), p.get("low"), p.get("high"))
            determined = "yes" if p.get("told") else "no"
            cells.append([str(row["window"]), str(p["parameter"]), value, span, determined])
    return Sheet(columns, cells, keys=2)


def channels_table(diagnosis: Mapping[str, Any]) -> Sheet:
    """Return a table of channels with verdicts and errors."""
    heads = [Column(head, right=True) for head in ("Before", "After", "Noise floor")]
    keys = ("channel", "verdict", "before", "after", "floor")
    cells = [[row[key] for key in keys] for row in map(channel_row, rows(diagnosis, "by_channel"))]
    return Sheet([Column("Channel"), Column("Verdict"), *heads], cells, keys=1)


def diagnosis_summary(diagnosis: Mapping[str, Any]) -> list[Block]:
    """Return the verdict in words, tables, indistinguishable effects, notes, and the next step."""
    out: list[Block] = []
    if verdict := diagnosis.get("verdict"):
        out.append(Line(words.verdict(diagnosis), head=str(verdict)))
    if before := words.baseline(diagnosis):
        out.append(Line(before))
    out += [Line(words.fall(diagnosis)), ladder_table(diagnosis)]
    if phases := contact_words.phases(diagnosis):
        out.append(Line(phases))
    if diagnosis.get("unexplained") and (residual := contact_words.left(diagnosis)):
        out.append(Line(residual))
    if diagnosis.get("by_channel"):
        out.append(channels_table(diagnosis))
    if diagnosis.get("effects"):
        out.append(effects_table(diagnosis))
        if (shares := shares_table(diagnosis)) is not None:
            out.append(shares)
        if any(effect.get("partial") for effect in rows(diagnosis, "effects")):
            out.append(Line(words.PARTIAL))
        if unsure := words.tentative(diagnosis):
            out.append(Line(unsure))
        for members in words.combinations(diagnosis):
            out.append(Line(f"only a combination of {words.join(members)} is determined"))
        for chosen, *others in words.rivals(diagnosis):
            out.append(Line(f"{chosen} cannot be told from {words.join(others, 'or')}"))
    if diagnosis.get("restarts"):
        out.append(restarts_table(diagnosis))
    for a, b, r in correlations(_record(diagnosis))["strong"][:3]:
        out.append(Line(f"note: {a} and {b} are correlated by {r}: trust their combination more than either"))
    noted = dict.fromkeys([*(row["said"] for row in rows(diagnosis, "windows")), *(diagnosis.get("missing") or ())])
    out += [Line(f"note: {note}") for note in noted]
    channels = [(row["record"], row["channel"]) for row in rows(diagnosis, "by_channel")]
    for record, channel in ((diagnosis, ""), *channels):
        if hidden := unseen.sentence(record, channel):
            out.append(Line(hidden))
        if record.get("evidence") == "contact":
            out += _closed_loop(record)
        if isinstance(views := record.get("views"), Mapping):
            out += [Line(sentence) for sentence in (*camera_words.projections(views), *camera_words.confounded(views))]
        # notes of joints and tosses stand on the page; those of several channels repeat those of each
        if record.get("evidence") == "contact" or isinstance(record.get("views"), Mapping):
            unlisted = [note for note in dict.fromkeys(record.get("notes") or ()) if note not in noted]
            out += [Line(f"note: {note}") for note in unlisted]
            noted |= dict.fromkeys(unlisted)
    if diagnosis.get("verdict"):
        out.append(Line(f"next: {words.onward(diagnosis)}"))
        out += [Line(sentence) for sentence in words.paid(diagnosis)]
        if price := words.price(diagnosis):
            out.append(Line(f"what the remainder costs a policy: {price}"))
    return out


def _closed_loop(diagnosis: Mapping[str, Any]) -> list[Block]:
    """Return the table of insertions in closed loop of a contact diagnosis; empty if there were none."""
    trials = [(row["recording"], *item) for row in rows(diagnosis, "closed_loop") for item in row["trials"].items()]
    if not trials:
        return []
    heads = [Column("Closed loop"), Column("Peak", right=True), Column("In contact", right=True), Column("Outcome")]
    cells = [
        [f"{name}: {run}", quantity(t["peak_force"], "N"), quantity(t["contact_s"], "s"), t["outcome"]]
        for name, run, t in trials
    ]
    return [Sheet(heads, cells)]


def written_lines(diagnosis: Mapping[str, Any], out: Path) -> list[Line]:
    """Return lines with the paths of the next motion, if there is one, and of the report."""
    following = diagnosis.get("next_experiment")
    motion = out / str(following.get("file") or "") if isinstance(following, Mapping) else out
    lines = [Line(f"next motion: {motion}", path=True)] if motion.is_file() else []
    return [*lines, report_line(out)]


def report_line(out: Path) -> Line:
    """Return a line with the path of the report."""
    return Line(f"report: {out / 'report.html'}", path=True)


def joints_table(comparison: Mapping[str, Any]) -> Sheet:
    """Return a table of error, noise floor, ratio and measured torque error of each joint (of a wrench, each axis)."""
    joints = rows(comparison, "joints")
    torque = any("torque_error" in row for row in joints)
    heads = ["Error", "Noise floor", "× floor", *(["Torque error"] if torque else [])]
    cells = []
    for row in joints:
        unit = str(row.get("unit") or "")
        line = [str(row.get("joint", "?")), quantity(row.get("error"), unit), quantity(row.get("floor"), unit)]
        line.append(fold(float(row["times_floor"])) if row.get("times_floor") else "–")
        cells.append(line + ([quantity(row.get("torque_error"), "N m RMS")] if torque else []))
    name = "Axis" if comparison.get("evidence") == "contact" else "Joint"
    return Sheet([Column(name), *(Column(head, right=True) for head in heads)], cells)


def comparison_summary(comparison: Mapping[str, Any]) -> list[Block]:
    """Return the error in words and for each joint, and where it arises."""
    out: list[Block] = [Line(sentence) for sentence in words.diverged(comparison)]
    joints = rows(comparison, "joints")
    out += [Line(words.fall(comparison)), *([joints_table(comparison)] if joints else [])]
    shares = [(row, number(row.get("share"))) for row in rows(comparison, "where_it_fails")]
    worst = [f"{r.get('joint')}, {r.get('regime')} ({100 * s:.0f} %)" for r, s in shares if s is not None]
    chi2, times = number(comparison.get("chi2")), [number(row.get("times_floor")) for row in joints]
    read = [t for t in times if t is not None]
    if read and chi2 is not None and chi2 <= words.NEAR_FLOOR**2 and max(read) <= words.NEAR_FLOOR:
        whose = "the model of the arm" if camera_words.cameras(comparison) else "the model"
        where = "everywhere" if len(read) == len(joints) else "in what was read"
        out.append(Line(f"{whose} is at the noise floor {where}"))
    elif worst:
        out.append(Line(f"where it fails: {'; '.join(worst[:3])}"))
    out += [Line(sentence) for sentence in words.drifted(rows(comparison, "drift"))]
    for other in rows(comparison, "by_channel"):
        out += [Line(f"channel {other['channel']}:"), *comparison_summary(other["record"])]
    out += [Line(sentence) for sentence in camera_words.cameras(comparison)]
    return out + [Line(f"note: {note}") for note in comparison.get("notes") or ()]


def _record(values: Mapping[str, Any]) -> Record:
    from vispeg.report.evidence import Evidence

    return Record("diagnosis", values, Evidence())
