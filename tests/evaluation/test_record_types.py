"""Records of evaluations hold the keys that their types name, and no other."""

from dataclasses import replace

from typed_record import mistakes

from vispeg.evaluation import gap, suite
from vispeg.evaluation.example import episodes
from vispeg.evaluation.schema.gap import GapRecord
from vispeg.evaluation.schema.stress import ExploitRecord, PushRecord, SweepRecord
from vispeg.evaluation.schema.suite import SuiteRecord, VersionChange
from vispeg.evaluation.stress import exploit, perturb, sensitivity


def test_a_gap_with_factors_and_a_robot():
    factors = episodes(("S", "V", "N", "VN"))
    trials = [replace(e, world="robot", world_hash="", seed=e.seed % 7) for e in episodes(("V",), n=6)]
    record = gap.gap([*factors, *trials], worlds=["S", "V", "N", "VN", "robot"])
    assert record["measures"] and record["attribution"] and record["comparisons"] and record["prediction"]
    assert not mistakes(GapRecord, record)


def test_stress_tests():
    pushed = perturb.summarise(episodes(("S",), ("corner", "corner, pushed", "other")))
    assert pushed["rows"][0]["cost"] is not None and not mistakes(PushRecord, pushed)
    what = sensitivity.SWEEPS["friction"]
    swept = sensitivity.summarise(episodes(("S",), [sensitivity.tag(what, v) for v in what.values]), [what])[0]
    assert "cost" in swept["curves"][0]["points"][0] and not mistakes(SweepRecord, swept)
    assert not mistakes(ExploitRecord, exploit.summarise(episodes(("S",), ("fixed", "randomized, 3 substeps"))))


def test_a_suite_of_many_configurations():
    runs = [e for i in range(9) for e in episodes(configurations=(f"c{i}",), n=4 + i)]
    record = suite.summarise(runs, "S", "V", "v1")
    assert "pearson" in record["health"] and not mistakes(SuiteRecord, record)
    assert not mistakes(list[VersionChange], suite.regressions(runs, runs))
