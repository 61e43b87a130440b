"""Whether the images matter: success where a policy sees another episode's, the first one for ever, or none at all."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.report.gap import words

TITLE = "Do the images matter?"


def context(values: Mapping[str, Any]) -> Mapping[str, object] | None:
    """A table a world: a row a policy, a column a control; None where there is neither control nor blind policy."""
    rates = {(r["policy"], r["world"], r["control"]): r["success"] for r in values["success"]}
    kinds = [c for c in words.CONTROLS if c and any(k == c for _, _, k in rates)]
    kinds += sorted({k for _, _, k in rates if k and k not in words.CONTROLS})
    tables = []
    for world in dict.fromkeys(w for _, w, k in rates if k):
        rows = []
        for policy in values["policies"]:
            cells = [rates.get((policy["name"], world, kind)) for kind in kinds]
            own = rates.get((policy["name"], world, ""))
            if any(cells) and own:
                texts = ["-" if e is None else words.rate(e) for e in cells]
                rows.append({"policy": policy["name"], "own": words.rate(own), "cells": texts})
        tables.append({"world": world, "rows": rows})
    blind = [
        f"{p['name']} sees nothing and has {words.rate(rates[p['name'], w, ''])} in {w}"
        for p in values["policies"]
        for w in (values["reference"], *([values["joint"]] if values["joint"] else []))
        if p["blind"] and (p["name"], w, "") in rates
    ]
    if not tables and not blind:
        return None
    return {"tables": tables, "heads": [words.CONTROLS.get(k, k) for k in kinds], "blind": blind}
