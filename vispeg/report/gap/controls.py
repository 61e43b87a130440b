"""Whether images matter: success with another episode's images, with a frozen first image, or without images."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.report.gap import bars, words
from vispeg.report.gap.colours import of_policies, ordered

TITLE = "Do the images matter?"


def context(values: Mapping[str, Any]) -> Mapping[str, object] | None:
    """Return a table of success for each world with controls, and a sentence for each blind policy.

    A row of a table is a policy: its success with its own images, then under each control. A policy that was not played
    with its own images in that world has no row.

    Args:
        values: content of gap.json (`vispeg.evaluation.schema.gap.GapRecord`).

    Returns:
        The arguments of `templates/gap/controls.html.j2`; None with neither controls nor blind policies.
    """
    rates = {(r["policy"], r["world"], r["control"]): r["success"] for r in values["success"]}
    kinds = [c for c in words.CONTROLS if c and any(k == c for _, _, k in rates)]
    kinds += sorted({k for _, _, k in rates if k and k not in words.CONTROLS})
    order, tables = ordered(values["policies"]), []
    styles, number = of_policies(order), {p["name"]: i for i, p in enumerate(order)}
    for world in dict.fromkeys(w for _, w, k in rates if k):
        rows = []
        for policy in order:
            cells = [rates.get((policy["name"], world, kind)) for kind in kinds]
            plain_rate = rates.get((policy["name"], world, ""))
            if any(cells) and plain_rate:
                name, style = policy["name"], styles[policy["name"]]
                drawn = [None if e is None else bars.bar(name, number[name], e, style) for e in (plain_rate, *cells)]
                rows.append({"policy": name, "number": number[name], "cells": drawn})
        if rows:
            tables.append({"world": world, "rows": rows})
    blind = [
        f"{p['name']} sees nothing and has {words.rate(rates[p['name'], w, ''])} in {w}"
        for p in values["policies"]
        for w in dict.fromkeys(w for w in (values["reference"], values["joint"]) if w)
        if p["blind"] and (p["name"], w, "") in rates
    ]
    if not tables and not blind:
        return None
    return {"tables": tables, "heads": [words.control(k) for k in kinds], "blind": blind}
