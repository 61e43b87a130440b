"""Writes the hash of a policy's weights into its policy.json, for policies that were saved without it.

python scripts/hash_policies.py assets/policies/*
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from vispeg.core.files import write_text_atomic
from vispeg.core.provenance import digest
from vispeg.learn.record import NETWORK, WEIGHTS, read_record
from vispeg.learn.shipped import META


def main() -> None:
    """Add the hash in each folder named on the command line."""
    for folder in map(Path, sys.argv[1:]):
        if not (folder / META).is_file():
            continue
        record = read_record(folder)
        if record["format"] == NETWORK.name and "weights" not in record:
            values = json.loads((folder / META).read_text(encoding="utf-8"))
            meta = values.pop("meta")
            values |= {"weights": f"sha256:{digest(folder / WEIGHTS)}", "meta": meta}
            write_text_atomic(folder / META, json.dumps(values, indent=2) + "\n", overwrite=True)
            print(folder)


if __name__ == "__main__":
    main()
