"""The page: whole for every verdict and every gap in the record, and sufficient to itself."""

import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from typed import typed

from vispeg.core.errors import UserError
from vispeg.report.build import write_report
from vispeg.report.evidence import load_evidence
from vispeg.report.sections import COMPARE, DIAGNOSIS
from vispeg.report.sections.found import remark
from vispeg.report.sections.next_experiment import again
from vispeg.report.text.summary import print_summary
from vispeg.report.text.terminal import diagnosis_summary, effects_table, ladder_table, written_lines


class _Page(HTMLParser):
    """Checks that tags nest, collects ids, section ids, references and text."""

    VOID = {"meta", "br", "link", "img", "hr", "wbr", "input"}

    def __init__(self, text: str):
        super().__init__()
        self.open, self.ids, self.sections, self.refs, self.tags, self.words = [], [], [], [], set(), []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.tags.add(tag)
        self.ids += [values["id"]] if "id" in values else []
        self.sections += [values["id"]] if tag == "section" else []
        self.refs += [v for k, v in attrs if k in ("href", "src", "xlink:href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in self.VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] not in ("style", "script"):
            self.words.append(data)

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", "".join(self.words))


def _page(out) -> _Page:
    text = write_report(out, overwrite=True).read_text(encoding="utf-8")
    page = _Page(text)
    assert len(page.ids) == len(set(page.ids)), "ids repeat"
    assert all(ref.startswith("#") and ref[1:] in page.ids for ref in page.refs)
    shown = re.sub(r"<script[^>]*>.*?</script>", "", text, flags=re.S)
    assert not re.search(r"https?://|@import|url\((?!#)", shown)
    assert (
        "script" not in page.tags
        or "default-src 'none'; img-src data:; media-src data:; style-src 'unsafe-inline'; script" in text
    )
    return page


@pytest.mark.parametrize("verdict", ["adequate", "identified", "ambiguous", "unexplained"])
def test_every_verdict_has_every_section(run, diagnosis, evidence, verdict):
    out = run(diagnosis(verdict), evidence(n=600, recordings=1, nj=4))
    page = _page(out)
    assert page.sections == [name for name in DIAGNOSIS if name not in ("rendered", "explore", "pictures", "proposal")]
    expected = {
        "adequate": "No effect is named.",
        "identified": "explain the held-out recordings down to the noise floor",
        "ambiguous": "Either Coulomb friction in joint 4 (1.31 N m) or Stribeck friction in joint 4",
        "unexplained": "A periodic rest with 23 cycles a turn of joint3.",
    }
    assert expected[verdict] in page.text
    assert ("Held-out error falls 40-fold" in page.text) == (verdict in ("identified", "ambiguous"))


@pytest.mark.parametrize("old", [False, True])
def test_what_helped_without_sufficing_is_called_partial(run, diagnosis, old):
    record = diagnosis("unexplained")
    apart = {"partial": record["effects"], "effects": []}
    record |= {"reason": "7 times the noise"} | (
        apart if old else {"effects": [e | {"partial": True} for e in record["effects"]]}
    )
    record["next_experiment"]["expected_separation_sigma"] = 0.0
    text = _page(run(record)).text
    assert "Partial. Each of these lowers the held-out error" in text and "No effect is named" not in text
    help_ = (
        "Payload at the flange (0.843 kg) and Coulomb friction in joint 4 (1.31 N m) help, but a structured residual"
    )
    assert help_ in text and "Coulomb friction in joint 4 coulomb_friction(joint4)" in text
    assert "It depends on position at joint3 and time." in text and "Why this verdict: 7 times the noise." in text
    assert "σ" not in text


def test_a_tentative_effect_stands_apart_from_those_that_are_named(run, diagnosis):
    record = diagnosis("unexplained")
    record["effects"] = [e | {"partial": True} for e in record["effects"]]
    record["effects"][0]["tentative"] = True
    text = _page(run(record)).text
    assert "Tentative. These too lower the held-out error" in text
    assert text.index("Coulomb friction in joint 4 coulomb_friction(joint4)") < text.index("Tentative. These too")


def test_gains_are_shares_of_the_squared_residual(run, diagnosis):
    text = _page(run(diagnosis())).text
    assert "31 %8.2explains less" in text and "−2.0 %–no held-out gain" in text


@pytest.mark.slow
def test_full_report_stays_small_and_shows_the_worst_recordings(run, diagnosis, evidence):
    arrays = evidence(n=12_000, recordings=5)
    for r in range(5):
        arrays |= {f"{r}/{k}_tau": 30 * arrays[f"{r}/{k}"] for k in ("measured", "before", "after")}
    arrays["1/after"] = arrays["1/measured"] + 0.1
    out = run(diagnosis(), arrays)
    page = _page(out)
    assert (out / "report.html").stat().st_size < 3e6
    assert "2 more are in the table" in page.text and "rig-d: residual rises" in page.text


def test_comparison_with_torques_and_no_final_model(run, diagnosis, evidence):
    record = {"format": "vispeg-compare/1", "ladder": diagnosis()["ladder"][:1], "noise_floor": None}
    record["ladder"][0] |= {"unit": "N m RMS", "heldout_error": 0.25}
    page = _page(run(record, evidence(unit="N m", after=False, n=600, recordings=1), kind="compare"))
    assert page.sections == [name for name in COMPARE if name not in ("explore", "pictures", "drift")]
    assert "Model error is 0.250 N m RMS." in page.text and "after" not in page.text
    assert "held-out" not in page.text.lower() and "held out" not in page.text.lower(), (
        "nothing is, as nothing is fitted"
    )
    assert "torque residual 0.249 N m RMS; largest at joint4 (0.600 N m RMS)" in page.text


@pytest.mark.parametrize("verdict", ["adequate", "identified", "ambiguous", "unexplained", None, "odd"])
def test_a_record_with_nothing_but_a_verdict(run, verdict):
    assert _page(run({"verdict": verdict})).sections == [
        name for name in DIAGNOSIS if name not in ("rendered", "explore", "pictures", "unseen", "proposal")
    ]


def test_every_key_may_be_null_and_every_number_missing(run, diagnosis):
    record = diagnosis("unexplained")
    for key in record:
        _page(run({**record, key: None}))

    def blank(value):
        if isinstance(value, dict):
            return {k: blank(v) for k, v in value.items()}
        if isinstance(value, list):
            return [blank(v) for v in value]
        return float("nan") if isinstance(value, float) else value

    assert "nan" not in _page(run(blank(record))).text.lower().split()


def test_arrays_without_a_single_finite_number(run, diagnosis, evidence):
    arrays = evidence(n=100, recordings=1, nj=2)
    blank = {
        k: np.full_like(v, np.nan) if re.search("before|after|measured|next/[AB]", k) else v for k, v in arrays.items()
    }
    assert "no residual" in _page(run(diagnosis(), blank)).text


def test_what_a_user_wrote_stays_text(run, diagnosis, evidence):
    nasty = "<script>alert(1)</script> $\\frac{ & \"'"
    record = diagnosis("ambiguous")
    record["effects"][1]["where"] = record["ladder"][0]["model"] = record["notes"][0] = nasty
    record["next_experiment"]["why"] = record["provenance"]["command"] = nasty
    arrays = evidence(n=100, recordings=1, nj=2)
    arrays["joints"] = np.array([nasty, *arrays["joints"][1:]])
    arrays["0/name"] = np.array(nasty)
    assert _page(run(record, arrays)).text.count("<script>alert(1)</script>") >= 5


def test_same_record_same_bytes(run, diagnosis, evidence):
    out = run(diagnosis(), evidence(n=300, recordings=1, nj=2))
    assert write_report(out).read_bytes() == write_report(out, overwrite=True).read_bytes()


def test_an_existing_report_is_kept(run, diagnosis):
    out = run(diagnosis())
    (out / "report.html").write_text("mine")
    with pytest.raises(UserError, match="exists"):
        write_report(out)
    assert (out / "report.html").read_text() == "mine"


def test_what_cannot_be_read_is_named(tmp_path, run, diagnosis, evidence):
    with pytest.raises(UserError, match=r"diagnosis\.json, compare\.json or fit\.json"):
        write_report(tmp_path / "nowhere")
    arrays = evidence(n=50, recordings=1, nj=7)
    with pytest.raises(UserError, match=r"evidence\.npz: 0/after: has the wrong shape"):
        write_report(run(diagnosis(), {**arrays, "0/after": arrays["0/after"][:, :6]}))
    out = run(diagnosis(), {**arrays, "joints": np.array(["a", None], dtype=object)})
    with pytest.raises(UserError, match=r"evidence\.npz"):
        write_report(out)
    (out / "diagnosis.json").write_text("{")
    with pytest.raises(UserError, match="is not JSON"):
        write_report(out)


def test_episodes_are_laid_end_to_end(run, diagnosis, evidence):
    arrays = evidence(n=200, recordings=1)
    arrays["0/time"] = np.tile(arrays["0/time"][:100], 2)
    time = load_evidence(run(diagnosis(), arrays) / "evidence.npz").traces[0].time
    np.testing.assert_allclose(time, np.arange(200) / 500, atol=1e-12)


def test_the_command_line_rebuilds(run, diagnosis, capsys):
    out = run(diagnosis())
    assert typed("report", out) == 0
    assert "down to the noise floor" in capsys.readouterr().out and (out / "report.html").exists()


def test_the_proposed_command_adds_a_recording_and_spares_the_first_results():
    from vispeg.report.evidence import Evidence
    from vispeg.report.record import Record

    for given, proposed in (("--out=a", "--out=a-2"), ("--out a/", "--out a-2"), ("--out=runs/a/", "--out=runs/a-2")):
        record = Record("diagnosis", {"provenance": {"command": f"vispeg diagnose 'my arm.xml' {given}"}}, Evidence())
        assert again(record) == f"vispeg diagnose 'my arm.xml' {proposed} --recording NEW-RECORDING"


def test_remarks_follow_from_the_numbers():
    from vispeg.core.params import Param

    p = Param(null=0.0, low=0.0, high=10.0, unit="N m", start=1.0)
    assert remark(1.0, 0.5, 1.5, p) == ""
    assert "null" in remark(0.1, -0.1, 0.3, p) and "bound" in remark(10.0, 9.0, 11.0, p)
    assert remark(1.0, None, None, p) == "no interval" and "bound" not in remark(0.0, -0.1, 0.1, p)


def test_the_terminal_says_verdict_fall_and_place(diagnosis, tmp_path, capsys):
    print_summary([*diagnosis_summary(diagnosis()), *written_lines(diagnosis(), tmp_path)])
    said = " ".join(capsys.readouterr().out.split())
    assert said.startswith(
        "identified: Payload at the flange (0.843 kg) and Coulomb friction in joint 4 (1.31 N m) explain"
    )
    assert "falls 40-fold" in said and said.endswith(str(tmp_path / "report.html"))


def test_terminal_tables_show_the_numbers(diagnosis):
    from rich.console import Console

    console = Console(width=140, record=True, file=open("/dev/null", "w"))
    record = json.loads(json.dumps(diagnosis("ambiguous")))
    record["ladder"][0]["model"] = "[red]nominal"
    console.print(ladder_table(record))
    console.print(effects_table(record))
    text = console.export_text()
    for part in ("[red]nominal", "0.220 mrad RMS", "1.10 ×", "1.224 to 1.401"):
        assert part in text
    console.file.close()


def test_the_terminal_says_what_cannot_be_told_apart(diagnosis, capsys):
    print_summary(diagnosis_summary(diagnosis("ambiguous")))
    said = " ".join(capsys.readouterr().out.split())
    assert "Coulomb friction in joint 4 (1.31 N m) cannot be told from Stribeck friction in joint 4" in said


def test_candidates_say_what_was_in_the_model_already(run, diagnosis):
    assert "tried beside" not in _page(run(diagnosis())).text
    record = diagnosis()
    record["candidates"][0]["tried_beside"] = []
    record["candidates"][1]["tried_beside"] = [{"effect": "payload", "where": "flange"}]
    text = _page(run(record)).text
    given, added = (
        text.index("1 tried beside the initial model, best gain 31 %"),
        text.index("1 tried beside payload(flange)"),
    )
    assert given < text.index("viscous_friction(joint4)31 %") < added < text.index("backlash(joint2)−2.0 %")
    assert "cogging(joint6)–" in text, "a record of before says nothing about it"


@pytest.mark.parametrize("count", [1, 2, 4, 5, 12])
def test_many_effects_come_as_one_table_and_what_stands_behind_it_is_closed(run, diagnosis, count):
    record = diagnosis()
    friction = record["effects"][1]
    record["effects"] = [friction | {"where": f"joint{i + 1}"} for i in range(count)]
    record["effects"][-1]["tentative"] = count > 1
    page = _page(run(record))
    assert ("The model lacks" in page.text) == ("details" in page.tags) == (count > 4)
    if count > 4:
        table = page.text[page.text.index("The model lacks") :].replace("1.312", "1.31")
        assert "1.31 N m1.224 to 1.401named" in table and "1.401tentative" in table
    assert page.text.count("friction torque in motion and at rest") == count, "each still has its own table"


@pytest.mark.parametrize("count", [1, 5])
def test_page_and_terminal_say_what_each_effect_explains_and_nothing_of_an_older_record(run, diagnosis, count, capsys):
    record = diagnosis()
    friction = record["effects"][1]
    record["effects"] = [friction | {"where": f"joint{i + 1}"} for i in range(count)]
    assert "of the excess" not in _page(run(record)).text
    print_summary(diagnosis_summary(record))
    assert "Explains" not in capsys.readouterr().out
    record["effects"][0] |= {"without": 12.34, "explains": 0.9321}
    text = _page(run(record)).text
    assert "It explains 93.2 % of the excess, the squared error of your model above the noise floor." in text
    assert "Without it, the other effects unchanged, the held-out error is 12 × the noise floor." in text
    assert ("named93.2 % of the excess; without it 12 × the noise floor" in text) == (count > 4)
    assert ("named–" in text) == (count > 4), "the others do not say"
    print_summary(diagnosis_summary(record))
    said = capsys.readouterr().out.splitlines()
    assert max(map(len, said)) <= 80
    (row,) = [line for line in said if "of the excess" in line]
    assert row.split() == "coulomb_friction(joint1) 93.2 % of the excess 12 × the noise floor".split()


def test_the_page_says_first_what_to_record_next(run, diagnosis):
    text = _page(run(diagnosis())).text
    assert text.index("Next. Record slow triangle on joint4") < text.index("What was found", text.index("Next."))


def test_a_value_at_its_bound_is_marked_in_every_table(run, diagnosis):
    from rich.console import Console

    record = diagnosis()

    def drawn():
        console = Console(width=120)
        with console.capture() as capture:
            console.print(effects_table(record))
        return capture.get()

    assert "bound" not in drawn()
    params = {"gain": {"value": 0.5, "low": 0.5, "high": 0.51, "unit": ""}}
    record["effects"].append({"effect": "torque_gain", "where": "joint2", "params": params})
    marked = [line for line in drawn().splitlines() if "at its bound" in line]
    assert len(marked) == 1 and "torque_gain(joint2)" in marked[0]
    assert "at a bound: the true value may lie beyond" in _page(run(record)).text


def test_the_phase_is_explained_where_it_is_drawn(run, diagnosis, evidence):
    text = _page(run(diagnosis(), evidence(n=300, recordings=1, nj=2))).text
    assert "Over phase: largest" in text and "0.5: upper turning point" in text
