"""The tables of ranges in docs/worlds.md are those of the worlds' files."""

import re
from pathlib import Path

import numpy as np
import pytest

from vispeg.task.world_file import load_world

PAGE = (Path(__file__).parents[2] / "docs" / "worlds.md").read_text(encoding="utf-8")
# word of the page -> effect, parameter, and what the page's number is of the parameter's: times, plus
ROWS = {
    "joint damping": ("viscous_friction", "damping", 1, 0), "gravity": ("gravity_scale", "scale", 100, -100),
    "payload": ("payload", "mass", 1, 0), "latency": ("command_delay", "delay", 1e3, 0),
    "hole": ("hole_offset", "x", 1e3, 0), "belief of the hole": ("goal_imprecision", "x", 1e3, 0),
    "peg mass": ("object_mass", "scale", 100, -100), "friction": ("contact_friction", "scale", 100, -100),
    "contact stiffness": ("contact_stiffness", "scale", 1, 0), "contact damping": ("contact_damping", "scale", 1, 0),
    "restitution": ("restitution", "e", 1, 0), "grip": ("gripper_slip", "grip", 1, 0),
    "solver iterations": ("solver_iterations", "scale", 100, 0),
    "dropped readings": ("dropped_readings", "chance", 100, 0),
    "joint angles: noise": ("encoder_noise", "sd", 1, 0), "joint angles: delay": ("sensor_delay", "delay", 1e3, 0),
    "joint velocities: noise": ("encoder_noise", "velocity", 1, 0), "wrench: gain": ("wrench_gain", "gain", 1, 0),
    "wrench: offset": ("wrench_bias", "fx", 1, 0), "wrench: noise": ("wrench_noise", "force", 1, 0),
    "wrench: delay": ("wrench_delay", "delay", 1e3, 0),
}  # fmt: skip


def rows(heading):
    """Word -> text of its range, of the table under `heading`; several of a row part at semicolons."""
    table = PAGE.split(f"| {heading} | range |\n|---|---|\n")[1].split("\n\n")[0]
    for line in table.splitlines():
        words, texts = (re.sub(r"\([^)]*\)", "", cell).strip() for cell in line.strip("| ").split(" | "))
        head = f"{words.split(':')[0]}: " if ":" in words else ""
        parts = (words.split(":")[1] if head else words).replace(",", ";").split(";")
        for word, text in zip(parts, texts.split(";"), strict=True):
            yield head + word.strip(), text.strip()


@pytest.mark.parametrize(("world", "heading"), [("randomized", "`randomized`"), ("randomized-readings", "`readings`")])
def test_every_range_in_the_page_is_the_file_s(world, heading):
    ranges = {r.effect: r.params for r in load_world(world).world.ranges}
    told = dict(rows(heading))
    for word, text in told.items():
        if word == "link masses":
            continue  # 10 % of each link's own mass; the file states kilograms
        effect, parameter, times, plus = ROWS[word]
        low, high = (times * ranges[effect][parameter].at(x) + plus for x in (0.0, 1.0))
        numbers = [float(x) for x in re.findall(r"\d+\.?\d*", text)]
        if text.startswith(("+-", "within", "up to")):
            assert (low, high) == pytest.approx((-numbers[0], numbers[0])), word
        else:
            assert (low, high) == pytest.approx(tuple(numbers[:2]), abs=1e-9), word
    assert len(told) >= 7


def test_link_masses_vary_by_a_tenth():
    from vispeg.robots.model import load

    model = load("iiwa14").spec().compile()
    for r in load_world("randomized").world.ranges:
        if r.effect == "link_mass":
            share = r.params["mass"].at(1.0) / model.body(r.where).mass[0]
            assert share == pytest.approx(0.1, abs=0.006) and np.isclose(
                r.params["mass"].at(0.0), -r.params["mass"].at(1.0)
            )


def test_a_contact_answers_no_faster_than_two_physics_steps():
    from vispeg.task.peg.config import PegConfig

    config = PegConfig()
    floor = 2 * config.control_period / config.substeps
    assert f"T has a floor of two physics steps, {1e3 * floor:.1f} ms in the task" in PAGE and config.solref[0] > floor
