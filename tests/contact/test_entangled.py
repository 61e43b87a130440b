"""What a recording determines in combination alone is ambiguous, and the motion that tells it apart is asked for."""

from pressed import recorded

from vispeg.contact.next_motion import separating
from vispeg.contact.run import evidence_of
from vispeg.contact.selection.confounded import beside, entangled, of_combinations
from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.findings import Verdict
from vispeg.identify.fit import fit_job
from vispeg.identify.pool import run_together
from vispeg.worlds.world import World

TOOL = EffectInstance.of("tool_mass", "gripper", mass=0.15)
PART = EffectInstance.of("object_mass", "peg", scale=1.5)
FRICTION = EffectInstance.of("contact_friction", "peg", scale=1.3)


def fitted(*effects: EffectInstance, n_fixed: int = 0):
    """A fit, of one step, of what may stand in for one another to a press with the tool upright."""
    evidence = evidence_of([recorded((TOOL,))])
    world = World().add(*effects)
    (fit,) = run_together([fit_job(evidence, world, range(n_fixed, len(effects)), iterations=1)], evidence.residuals)
    return fit


def test_masses_of_tool_and_part_are_one_combination_without_friction():
    """One attitude, one weight: how much of it is the tool's, and how much the part's, no press says."""
    fit = fitted(TOOL, PART, FRICTION)
    (together,) = entangled(fit, 0)
    assert [e.effect for e in together] == ["tool_mass", "object_mass"]
    verdict = of_combinations(Verdict("identified", "all"), [together])
    assert verdict.verdict == "ambiguous" and all(e.label in verdict.reason for e in together)
    record = [{"effect": e.effect, "where": e.where, "indistinguishable_from": []} for e in (TOOL, PART, FRICTION)]
    found = beside(record, [together])
    assert [[o["effect"] for o in e["indistinguishable_from"]] for e in found] == [["object_mass"], ["tool_mass"], []]
    assert separating(fit.world, [], [], [together])["motion"] == "free, with and without the held part"


def test_given_and_distinguishable_effects_are_no_combination():
    assert entangled(fitted(TOOL, FRICTION), 0) == []
    assert entangled(fitted(PART, TOOL, n_fixed=1), 1) == []
    assert of_combinations(Verdict("identified", "both"), []).verdict == "identified"
