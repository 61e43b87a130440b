"""Pages on success stand alone, show the numbers of their record, and survive odd names and missing parts."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from pages import plain

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.evaluation import suite
from vispeg.evaluation.films.video import write_image, write_video
from vispeg.evaluation.gap import gap
from vispeg.evaluation.records import Episode
from vispeg.evaluation.stress import exploit, perturb, sensitivity
from vispeg.render.image_kinds import SHOWN, depth_picture
from vispeg.report.drawings import palette
from vispeg.report.drawings.figures import WIDE
from vispeg.report.gap import controls, suite_page, words
from vispeg.report.gap.bars import bar
from vispeg.report.gap.build import render, write
from vispeg.report.gap.colours import of_categories, of_policies
from vispeg.report.gap.headline import context
from vispeg.report.gap.stress_pages import _profiles, exploit_page, perturb_page, sensitivity_page
from vispeg.report.live.episodes import context as paired
from vispeg.task.registry import FIRST, task

WORLDS = {"S": 0.95, "V": 0.85, "P": 0.75, "VP": 0.5}


def episodes(policy="depth", modality="depth", worlds=WORLDS, n=40, **more):
    found = []
    for world, p in worlds.items():
        rng = stream(0, policy, world)
        for s in range(n):
            ok = bool(rng.uniform() < p)
            head = (
                policy,
                modality,
                0,
                world,
                f"hash-{world}",
                s,
                ok,
                "success" if ok else str(rng.choice(["jam", "slip"])),
            )
            found.append(Episode(*head, time=3.0, peak_force=20.0, **more))
    return found


def alone(html: str) -> None:
    assert "@import" not in html and not re.search(r"<script[^>]*\ssrc", html)
    assert "<script" not in html or "default-src 'none'" in html
    assert not re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', html)
    assert not re.findall(r"https?://(?!www\.w3\.org)", html)
    ids = re.findall(r'\bid="([^"]+)"', html)
    assert len(ids) == len(set(ids))


def test_the_page_stands_alone_and_shows_the_records_numbers():
    values = gap([*episodes(), *episodes("rgb", "rgb"), *episodes("blind", "proprio")], worlds=list(WORLDS))
    html = render(values)
    alone(html)
    for row in values["success"]:
        assert words.percent(row["success"]["value"]) in html
    for row in values["gaps"]:
        assert words.change(row["gap"]) in html
    assert "The gap to VP, split" in html and "hash-VP" in html and "sees nothing" in html


def test_the_page_opens_with_its_picture_and_says_what_the_worlds_are():
    from vispeg.task.world_file import load_world

    values = gap([*episodes(), *episodes("rgb", "rgb")], worlds=list(WORLDS))
    values["worlds"] = [
        {**w, "hash": load_world(w["name"]).hash if w["name"] != "VP" else "x"} for w in values["worlds"]
    ]
    for policy in values["policies"]:
        policy["home"] = ["S"]
    html = render(values)
    main = html[html.index("<main>") :]
    assert main.index("<h1>") < main.index("<figure>") < main.index("<li>") < main.index("<table")
    assert "training world" in main[: main.index("</figure>")] and "unseen looks" in main[: main.index("</figure>")]
    first = main[: main.index("<h2>")]
    assert "<b>S</b>: Training world of policies with cameras" in first
    assert "<b>P</b>: Target world of the physics factor" in first
    assert "<b>VP</b>: " not in first, "a world of another's making is not described as one of ours"


def test_many_pairs_are_folded_and_counted():
    nine = [e for i in range(9) for e in episodes(f"d{i}", "depth", n=12)]
    html = render(gap(nine, worlds=list(WORLDS)))
    folded = re.findall(r"<details(.*?)><summary>(.*?)</summary>", html)
    pairs = [text for attributes, text in folded if "of 36 pairs differ" in text and not attributes]
    assert len(pairs) == len(WORLDS)


def test_a_world_is_called_that_of_training_only_where_the_records_say_so():
    both = [*episodes(), *episodes("rgb", "rgb")]
    assert "training world" not in render(gap(both, worlds=list(WORLDS)))
    hashes = {"depth": ["hash-S"], "rgb": ["hash-S"]}
    html = render(gap(both, worlds=list(WORLDS), homes=hashes))
    assert "training world" in html and "the world of training" in html and "(home)" not in html
    other = render(gap(both, worlds=list(WORLDS), homes={**hashes, "rgb": ["hash-V"]}))
    assert "training world" not in other and "depth<br>(home)" in other and "rgb<br>(home)" in other
    older = render(gap(both, worlds=list(WORLDS), homes=dict.fromkeys(hashes, ["hash-before-it-changed"])))
    assert "none of these, as they are now" in older and "(home)" not in older


def test_training_seeds_are_spoken_of_where_there_are_several():
    one = render(gap(episodes(), worlds=list(WORLDS)))
    assert "over training seeds" not in one and "one training seed" in one
    three = [replace(e, train_seed=t) for t in range(3) for e in episodes()]
    assert "over training seeds where a policy has several" in render(gap(three, worlds=list(WORLDS)))


def test_a_loss_is_printed_as_a_loss_and_called_one_where_it_is_decided():
    sure, few = dict.fromkeys(WORLDS, 1.0), {"S": 1.0, "V": 0.9}
    lost = gap(episodes(worlds={**sure, "VP": 0.2}), worlds=list(WORLDS))
    row = next(g for g in lost["gaps"] if g["world"] == "VP")
    assert row["words"].startswith("loses") and words.change(row["gap"]).startswith("\N{MINUS SIGN}")
    little = gap(episodes(worlds=few), worlds=list(few))
    assert little["gaps"][0]["verdict"] != "different"
    said = render(little).split("<main>")[1]
    assert "loses" not in said and "color-mix" not in said


def test_a_policy_has_the_colour_of_what_it_sees_and_the_second_is_hatched():
    from vispeg.report.gap.colours import BY_MODALITY

    both = [{"name": n, "modality": m} for n, m in (("a", "depth"), ("b", "depth"), ("c", "proprio"))]
    found = of_policies(both)
    assert found["a"].colour == found["b"].colour == BY_MODALITY["depth"]
    assert (found["a"].hatch, bool(found["b"].hatch)) == (None, True)
    many = of_policies([{"name": str(i), "modality": "rgbd"} for i in range(4)])
    assert len({s.colour for s in many.values()}) == 4 and not any(s.second for s in many.values())


def test_every_policy_and_every_end_of_a_picture_has_a_colour_of_its_own_by_day_and_by_night():
    """Also a policy with privileged inputs beside many of one modality, and words of the user's own."""
    seen = ["rgbd"] * 5 + ["privileged", "proprio", "tactile", "state", "depth", "rgb"]
    policies = [{"name": str(i), "modality": m} for i, m in enumerate(seen)]
    drawn = of_policies(policies)
    assert of_policies(policies[::-1])["5"] == drawn["5"], "the order of a picture changes no colour"
    colours = [s.colour for s in drawn.values()]
    ends = [*task(FIRST).categories, "failure", "operator", "cable"]
    failures = [*of_categories(ends).values()]
    for picture in (colours, failures):
        nights = {palette.COLOURS[palette.name_of(colour)][1] for colour in picture}
        assert len(set(picture)) == len(nights) == len(picture)
    robot = [replace(e, world="robot", category=w, success=False) for e, w in zip(episodes(), ends[1:], strict=False)]
    both = [*episodes(), *robot]
    strip = json.loads(paired(gap(both, worlds=["S", "robot"]), both)["data"])
    assert {*ends} == {*strip["ends"]} and len({*strip["colours"]}) == len(ends)


def headline(*known):
    return context(gap([e for one in known for e in one], worlds=list(WORLDS)))


def test_the_headline_crowns_who_sees_and_marks_who_is_told_the_hole():
    sure = dict.fromkeys(WORLDS, 1.0)
    teacher, blind = episodes("state", "state", sure), episodes("blind", "proprio")
    seeing = [episodes(f"d{i}", "depth", {**WORLDS, "VP": 0.1 * i}) for i in range(1, 7)]
    found = headline(teacher, blind, *seeing)
    assert found["title"].startswith("d") and "of 40 episodes in VP; whether that is more than" in found["title"]
    assert [n for n, *_ in found["figures"]].count("state") == 0 and len(found["figures"]) == 5
    shown = [float(value.removesuffix(" %")) for _, value, _ in found["figures"]]
    assert shown == sorted(shown, reverse=True)
    few = headline(teacher, blind, seeing[0])
    assert few["title"].startswith("d1 in VP: ")
    assert [n for n, *_ in few["figures"]] == ["d1", "state", "blind"] == [line["policy"] for line in few["lines"]]
    assert [line["role"] for line in few["lines"]] == ["", "teacher, told the goal", "blind"]
    assert few["figures"][1][2].startswith("teacher, told the goal; ")
    assert headline(teacher, blind)["title"].startswith("state in VP: 100 % (91 to 100) of 40 episodes")
    best = headline(seeing[0], episodes("d9", "depth", {**WORLDS, "VP": 0.9}))
    assert best["title"].startswith("d9 keeps most in VP: ") and "of 40 episodes" in best["title"]
    html = render(gap([*teacher, *blind, *seeing[0]], worlds=list(WORLDS)))
    alone(html)
    assert html.count("teacher, told the goal</span>") == 2
    assert html.count("blind control</span>") == 1


def test_one_world_without_targets_is_a_page_too():
    html = render(gap(episodes(worlds={"S": 0.9})))
    alone(html)
    assert "depth in S: 36 of 40 succeed, so" in html and "What the change costs" not in html


def test_where_nothing_fails_there_is_no_empty_section_on_failures():
    assert "How they fail" not in render(gap(episodes(worlds={"S": 1.0})))
    assert "How they fail" in render(gap(episodes(worlds={"S": 0.5})))


def test_names_are_shown_as_they_are_and_never_run():
    odd = "<script>alert(1)</script> & $x$"
    html = render(gap([replace(e, policy=odd) for e in episodes()]))
    alone(html)
    assert "&lt;script&gt;" in html


def test_videos_and_stills_are_inside_the_page(tmp_path):
    frames = np.zeros((12, 33, 48, 3), np.uint8)
    frames[:, :, :24] = 200
    video = write_video(tmp_path / "media" / "v", frames, 6.25)
    still = write_image(tmp_path / "media" / "s.png", frames[0])
    side = {
        "world": "S",
        "outcome": "success after 3.0 s",
        "video": f"media/{video.name}",
        "image": "media/s.png",
        "view": None,
    }
    values = gap(episodes())
    (tmp_path / "gap.json").write_text(json.dumps(values))
    (tmp_path / "media.json").write_text(json.dumps([{"policy": "depth", "seed": 3, "sides": [side, side]}]))
    html = write(tmp_path).read_text()
    alone(html)
    assert (
        base64.b64encode(video.read_bytes()).decode() in html and base64.b64encode(still.read_bytes()).decode() in html
    )
    with pytest.raises(UserError, match="exists already"):
        write(tmp_path)
    still.unlink()
    with pytest.raises(UserError, match="s.png: not a video or picture"):
        write(tmp_path, overwrite=True)


def test_a_video_is_one_that_plays_with_the_frames_it_was_given(tmp_path):
    import cv2

    frames = np.zeros((10, 32, 48, 3), np.uint8)
    for i in range(10):
        frames[i, :, : 4 * i + 4] = (200, 60, 20)
    path = write_video(tmp_path / "v", frames, 12.5)
    assert path.suffix == ".mp4" and path.stat().st_size > 200
    reader = cv2.VideoCapture(str(path))
    assert reader.get(cv2.CAP_PROP_FPS) == 12.5
    back = []
    while (got := reader.read())[0]:
        back.append(cv2.cvtColor(got[1], cv2.COLOR_BGR2RGB))
    assert len(back) == 10 and back[0].shape == (32, 48, 3)
    assert np.abs(back[9].astype(int) - frames[9]).mean() < 12  # red stays red: no channel swapped
    with pytest.raises(UserError, match="not a video"):
        write_video(tmp_path / "w", frames.astype(float), 12.5)


def test_videos_of_names_with_dots_are_files_of_their_own(tmp_path):
    frames = np.zeros((2, 32, 48, 3), np.uint8)
    paths = [write_video(tmp_path / f"depth_lr0.1-S-{seed}", frames, 12.5) for seed in (1000003, 1000004)]
    assert [p.name for p in paths] == ["depth_lr0.1-S-1000003.mp4", "depth_lr0.1-S-1000004.mp4"]
    assert all(p.is_file() for p in paths)


def test_a_picture_is_written_without_a_word(tmp_path, capfd):
    image = np.full((8, 8, 3), 90, np.uint8)
    for suffix in (".png", ".jpg"):
        assert write_image(tmp_path / f"v{suffix}", image).stat().st_size > 50
    assert capfd.readouterr() == ("", "")


def test_a_video_that_cannot_be_made_says_why(tmp_path, monkeypatch):
    def lacking():
        raise RuntimeError("No ffmpeg exe could be found.")

    frames = np.zeros((2, 32, 48, 3), np.uint8)
    monkeypatch.setattr("imageio_ffmpeg.get_ffmpeg_exe", lacking)  # as where there is none
    with pytest.raises(UserError, match=r"v\.mp4: no ffmpeg here"):
        write_video(tmp_path / "v", frames, 12.5)
    monkeypatch.undo()
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", "false")  # a program that fails
    with pytest.raises(UserError, match="ffmpeg failed"):
        write_video(tmp_path / "v", frames, 12.5)


@pytest.mark.parametrize(
    ("text", "words"), [("[]", "is not a gap's record"), ("{", "is not JSON"), ('{"format": "x"}', "x")]
)
def test_another_file_is_refused(tmp_path, text, words):
    (tmp_path / "gap.json").write_text(text)
    with pytest.raises(UserError, match=words):
        write(tmp_path)


def test_the_smaller_pages_stand_alone_too():
    what = sensitivity.SWEEPS["latency"]
    sweep = [
        e for v in what.values for e in episodes(worlds={"S": 0.9 - 10 * v}, configuration=sensitivity.tag(what, v))
    ]
    alone(sensitivity_page({"sweeps": sensitivity.summarise(sweep, [what])}))
    sides = [e for c in ("fixed", "randomized, 3 substeps") for e in episodes(worlds={"S": 0.9}, configuration=c)]
    sides = [replace(e, force_profile=(0.0, 5.0, 9.0, 12.0)) for e in sides]
    alone(exploit_page(exploit.summarise(sides)))
    places = [e for c in ("edge", "edge, pushed", "anywhere") for e in episodes(worlds={"S": 0.8}, configuration=c)]
    alone(perturb_page({**perturb.summarise(places), "force": (20, 60), "duration": 0.2}))
    runs = [e for i in range(9) for e in episodes(worlds={"S": 0.1 * i, "T": 0.1 * i}, configuration=f"c{i}")]
    version = suite.summarise(runs, "S", "T", "v1")
    alone(suite_page.render([version, {**version, "version": "v2"}], suite.regressions(runs, runs)))


def test_forces_are_drawn_over_the_time_between_two_actions():
    """A tenth of a second where the episodes took that; a record that does not state it is of the usual 0.16 s."""
    sides = [e for c in ("fixed", "randomized, 3 substeps") for e in episodes(worlds={"S": 0.9}, configuration=c)]
    record = exploit.summarise([replace(e, time=0.4, force_profile=(0.0, 5.0, 9.0, 12.0)) for e in sides])
    for row in record["policies"]:
        assert row["policy_period"] == pytest.approx(0.1)
    old = [{k: v for k, v in row.items() if k != "policy_period"} for row in record["policies"]]
    for policies, period in ((record["policies"], 0.1), (old, 0.16)):
        line = _profiles(policies, WIDE).axes[0].get_lines()[0]
        assert line.get_xdata() == pytest.approx([0.0, period, 2 * period])


def test_the_smaller_pages_speak_in_words():
    """No dimensionless unit 1, no crowned weakest of equals, a sentence after a policy's name."""
    what = sensitivity.SWEEPS["friction"]
    tag = sensitivity.tag
    sweep = [e for v in what.values for e in episodes(worlds={"S": 1.0}, configuration=tag(what, v))]
    html = sensitivity_page({"sweeps": sensitivity.summarise(sweep, [what])})
    assert "Contact friction: scale" in html and "contact_friction.scale, 1<" not in html and "to 3 1" not in html
    kinds = [f"{place}{side}" for place in ("anywhere", "edge") for side in ("", ", pushed")]
    places = [e for c in kinds for e in episodes(worlds={"S": 1.0 if c != "edge" else 0.0}, configuration=c)]
    more = {"force": (20, 60), "duration": 0.2}
    html = perturb_page({**perturb.summarise(places), **more})
    assert "depth: weakest edge: 0 %" in plain(html) and "once an episode<" in html
    alike = [replace(e, success=True) for e in places]
    assert "still, in every position" in perturb_page({**perturb.summarise(alike), **more})


def test_text_has_no_negative_zero_and_no_false_certainty():
    half = {"value": 0.5, "low": 0.25, "high": None, "n": 2}  # with an end that no data determine
    assert (words.rate(half), words.signed(half), words.rate(None)) == ("50 %", "+50", "-")
    assert words.signed({"value": -0.001, "low": -0.004, "high": 0.12}) == "0 (0 to 12)"
    assert (
        words.change({"value": 0.2, "low": 0.1, "high": 0.31})
        == "\N{MINUS SIGN}20 (\N{MINUS SIGN}31 to \N{MINUS SIGN}10)"
    )
    assert words.p_value(0.0000001) == "< 0.001" and words.p_value(None) == "-"
    assert words.percent(1.0) == "100 %" and words.percent(0.9976) == "99.8 %"
    assert words.percent(-0.0001) == "0 %" and words.percent(-0.12) == "\N{MINUS SIGN}12 %"


def test_a_bar_s_rate_is_rounded_once():
    """7 of 52 are 13.46 %: 13 % on the bar, not the 14 % of a rounded 13.5 %."""
    style = of_policies([{"name": "depth", "modality": "depth"}])["depth"]
    drawn = bar("depth", 0, {"value": 7 / 52, "low": 0.1246, "high": 0.1446, "n": 52}, style)
    assert (drawn.percent, f"{drawn.low:.0f}", f"{drawn.high:.0f}") == ("13\N{NO-BREAK SPACE}%", "12", "14")


def test_many_hours_have_no_exponent():
    assert words.hours(125.0) == "125 h" and words.hours(1.26) == "1.3 h" and words.hours(None) == "not known"


def test_a_film_is_offered_only_for_the_network_that_it_shows():
    both = [replace(e, train_seed=t) for t in range(2) for e in episodes()]
    film = {"policy": "depth", "train_seed": 0, "seed": 3, "sides": [{"world": "S"}]}
    data = json.loads(paired(gap(both, worlds=list(WORLDS)), both, [film])["data"])
    (shown,) = data["films"]
    assert [data["names"][k] for k, t in enumerate(data["trained"]) if t == shown["trained"]] == ["depth (seed 0)"]


def test_the_words_beside_depth_name_its_colours(tmp_path):
    (near, none), (far, _) = (depth_picture(np.array([[d, 0.0]]))[0].astype(int) for d in SHOWN)
    assert near.argmax() == 0 and far.argmax() == 2 and not none.any()
    side = {"world": "S", "outcome": "jam after 3.0 s"}
    html = render(gap(episodes()), [{"policy": "depth", "seed": 3, "sides": [side, side]}], tmp_path)
    assert "near is red, far is blue, no reading is black" in html


def test_a_control_without_the_policys_own_images_makes_no_table():
    success = {"value": 0.5, "low": 0.4, "high": 0.6, "n": 100}
    row = {"policy": "p", "control": "", "success": success}
    values = {
        "policies": [{"name": "p", "modality": "proprio", "blind": True}],
        "success": [{**row, "world": "home"}, {**row, "world": "away", "control": "blank"}],
        "reference": "home",
        "joint": "home",
    }
    shown = controls.context(values)
    assert shown["tables"] == []
    assert shown["blind"] == ["p sees nothing and has 50 % (40 to 60) in home"], "once, though it is both worlds"
