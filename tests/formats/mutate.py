"""Ways to damage a file: its bytes, its text, what its text says, and what it is."""

from __future__ import annotations

import json
import os
import random
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

TOKEN = "ZZTOKENZZ"
DEEP = "[" * 3000
BOMB = "{a: &a [x, x, x, x, x, x, x, x, x], " + ", ".join(
    f"{n}: &{n} [{', '.join(['*' + p] * 9)}]" for p, n in zip("abcdefgh", "bcdefghi", strict=True)
)
VALUES: list[Any] = [
    None,
    True,
    False,
    0,
    -1,
    1,
    2,
    0.5,
    -1e-9,
    1e9,
    -1e308,
    10**18,
    10**30,
    "",
    " ",
    "x",
    "nan",
    "1e5",
]
VALUES += ["-1", "é" * 9, "a" * 5000, "../../../etc/passwd", "~nobody/x.yaml", "/dev/zero", "{x}", "%s", "a\nb", [], {}]
VALUES += [[[]], [{}], [None], [1, 2, 3], ["a", "a"], {"x": 1}, {"format": "x"}, [0.0] * 3, [1e300] * 7]
RAW = [
    "NaN",
    "Infinity",
    "-Infinity",
    ".nan",
    ".inf",
    "1e999",
    "9" * 400,
    "9" * 9000,
    '"\\u0000"',
    '"\\ud800"',
    "2024-99-99",
]
RAW += [
    DEEP,
    BOMB + "}",
    "&q [*q]",
    "*nothing",
    "!!python/object/apply:os.system [id]",
    "!!binary aGk=",
    "0b",
    "1:59:59",
    "\t",
]
CELLS = ["", "nan", "inf", "-inf", "x", "1e309", "-1", "1,5", "0x10", "9" * 500, '"', "1_000", "é", "True"]
NUMBERS = ["nan", "inf", "-1", "0", "1e300", "-1e-300", "x", "", "1 2 3 4", "1000000", "99999999999999", "../up", "é"]


def of_bytes(data: bytes, rng: random.Random) -> bytes:
    """Flips, cuts, repeats, other encodings, nothing at all."""
    at = rng.randrange(len(data) + 1)
    kind = rng.randrange(10)
    if kind == 0:
        return data[:at]
    if kind == 1:
        return data[at:]
    if kind == 2:
        return b""
    if kind == 3:
        return data[:at] + data[at // 2 : at] * 3 + data[at:]
    if kind == 4:
        return b"\xef\xbb\xbf" + data
    if kind == 5:
        return data.decode("utf-8", "replace").encode(rng.choice(["utf-16", "utf-16-le", "utf-32", "cp037"]), "replace")
    if kind == 6:
        return data[:at] + rng.choice([b"\xe9", b"\x00", b"\xff\xfe", b"\x1b[2J", b"\r", b"\xc0\x80"]) + data[at:]
    if kind == 7:
        return data.replace(b"\n", b"\r\n" if rng.random() < 0.5 else b"\r")
    many = bytearray(data)
    for _ in range(rng.randint(1, 8) if many else 0):
        many[rng.randrange(len(many))] = rng.randrange(256)
    return bytes(many)


def of_tree(data: Any, rng: random.Random) -> tuple[Any, str]:
    """Plain data with a value changed, gone or new somewhere; TOKEN stands for the raw text that is returned."""
    places = list(_places(data))
    raw = rng.choice(RAW)
    if not places:
        return rng.choice(VALUES), raw
    holder, key = rng.choice(places)
    kind = rng.randrange(8)
    if kind == 0:
        del holder[key]
    elif kind == 1:
        holder[key] = TOKEN
    elif kind == 2 and isinstance(holder, dict):
        holder[rng.choice(["zz", "format", str(key) + "s", "", "a" * 300, "é\n"])] = rng.choice(VALUES)
    elif kind == 2:
        holder.extend(list(holder) * rng.choice([1, 50]))
    elif kind == 3:
        holder[key] = [holder[key]] if rng.random() < 0.5 else {"value": holder[key]}
    elif kind == 4 and isinstance(holder[key], (int, float)):
        holder[key] = rng.choice([-holder[key], holder[key] * 1e6, str(holder[key]), holder[key] * 1e-9, 1e30, -1])
    elif kind == 5:
        other, there = rng.choice(places)
        holder[key] = json.loads(json.dumps(other.get(there) if isinstance(other, dict) else (other + [None])[0]))
    else:
        holder[key] = rng.choice(VALUES)
    return data, raw


def of_json(text: str, rng: random.Random) -> str:
    """JSON, or one line of many."""
    lines = text.splitlines()
    if len(lines) > 1 and all(line.startswith("{") and line.endswith("}") for line in lines):
        at = rng.randrange(len(lines))
        return "\n".join([*lines[:at], of_json(lines[at], rng), *lines[at + 1 :]]) + "\n"
    data, raw = of_tree(json.loads(text), rng)
    out = json.dumps(data)
    if rng.random() < 0.1:
        out = re.sub(r'"(\w+)": ', r'"\1": 0, "\1": ', out, count=1)
    return out.replace(f'"{TOKEN}"', raw) + "\n"


def of_yaml(text: str, rng: random.Random) -> str:
    """YAML, with the lines that only OpenCV writes kept."""
    opencv = text.startswith("%YAML:1.0")
    body = text.partition("\n")[2].replace("!!opencv-matrix", "") if opencv else text
    data, raw = of_tree(yaml.safe_load(body), rng)
    out = yaml.safe_dump(data, sort_keys=False)
    if rng.random() < 0.1:
        lines = out.splitlines()
        out = "\n".join([*lines, rng.choice(lines)]) + "\n"
    return ("%YAML:1.0\n---\n" if opencv else "") + out.replace(TOKEN, raw)


def of_csv(text: str, rng: random.Random) -> str:
    """A table with another cell, row, column or separator."""
    rows = [line.split(",") for line in text.splitlines()]
    row = rng.randrange(len(rows))
    column = rng.randrange(len(rows[row]))
    kind = rng.randrange(7)
    if kind == 0:
        del rows[row]
    elif kind == 1:
        rows.insert(row, list(rng.choice(rows)))
    elif kind == 2:
        rows = [cells[:column] + cells[column + 1 :] for cells in rows]
    elif kind == 3:
        return text.replace(",", rng.choice([";", "\t", ",,", " "]))
    elif kind == 4:
        rows[row].append(rng.choice(CELLS))
    else:
        rows[row][column] = rng.choice(CELLS)
    return "\n".join(",".join(cells) for cells in rows) + "\n"


def of_xml(text: str, rng: random.Random) -> str:
    """An element or attribute changed, gone, moved or copied; entities; depth."""
    kind = rng.randrange(10)
    if kind == 0:
        head = '<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;"><!ENTITY c SYSTEM "file:///dev/zero">]>'
        return head + re.sub(r"<\?xml.*?\?>", "", text).replace('="', '="&c;&b;', 1)
    if kind == 1:
        return text.replace(">", "><body>" * rng.choice([3, 400]), 1)
    if kind == 2:
        return text.replace(
            'version="1.0"', f'version="1.0" encoding="{rng.choice(["latin-1", "utf-16", "x", "shift_jis"])}"'
        )
    root = ET.fromstring(text)
    elements = list(root.iter())
    element, parents = rng.choice(elements), {child: parent for parent in elements for child in parent}
    if kind == 3 and element in parents:
        parents[element].remove(element)
    elif kind == 4 and element in parents:
        parents[element].append(element)
    elif kind == 5:
        rng.choice(elements[:1] + elements[-3:]).append(ET.fromstring(ET.tostring(element)))
    elif kind == 6:
        element.tag = rng.choice([*(e.tag for e in elements), "zz"])
    elif element.attrib:
        key = rng.choice(list(element.attrib))
        if kind == 7:
            del element.attrib[key]
        else:
            words = element.attrib[key].split() or [""]
            words[rng.randrange(len(words))] = rng.choice(NUMBERS)
            element.attrib[key] = rng.choice([" ".join(words), rng.choice(NUMBERS), element.attrib[key] * 3])
    return ET.tostring(root, encoding="unicode")


TEXTS: dict[str, Callable[[str, random.Random], str]] = {
    ".json": of_json,
    ".jsonl": of_json,
    ".yaml": of_yaml,
    ".csv": of_csv,
    ".xml": of_xml,
    ".urdf": of_xml,
}


def damage(path: Path, rng: random.Random) -> None:
    """Damages the file."""
    data = path.read_bytes()
    kind = rng.random()
    if kind < 0.04:
        path.unlink()
        rng.choice([os.mkfifo, Path.mkdir, _nothing, lambda p: p.symlink_to("/dev/zero"), lambda p: p.symlink_to(p)])(
            path
        )
    elif path.suffix in TEXTS and kind < 0.75:
        path.write_bytes(TEXTS[path.suffix](data.decode("utf-8"), rng).encode("utf-8", "surrogatepass"))
    else:
        path.write_bytes(of_bytes(data, rng))


def _nothing(path: Path) -> None:
    """The file is gone."""


def _places(data: Any) -> Any:
    """(holder, key) of every value in nested lists and mappings."""
    for key, value in list(
        data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    ):
        yield data, key
        yield from _places(value)
