"""Invented episodes, from which the example files of the formats are made."""

from __future__ import annotations

from collections.abc import Sequence

from vispeg.evaluation.records import Episode


def episodes(worlds: Sequence[str] = ("S", "V"), configurations: Sequence[str] = ("",), n: int = 4) -> list[Episode]:
    """Return n episodes of a policy with images and of one without, in every world and configuration."""
    records = []
    for policy, modality in (("depth", "depth"), ("blind", "proprio")):
        for i, world in enumerate(worlds):
            for configuration in configurations:
                for seed in range(n):
                    ok = modality == "depth" and seed >= i
                    records.append(
                        Episode(
                            policy,
                            modality,
                            0,
                            world,
                            f"hash of {world} {configuration}",
                            1_000_000 + seed,
                            ok,
                            "success" if ok else "jam",
                            time=3.2,
                            peak_force=20.0,
                            configuration=configuration,
                            force_profile=(0.0, 5.0, 9.0),
                        )
                    )
    return records
