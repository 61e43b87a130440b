"""Convert plain data to dataclasses and pydantic models, with errors for users."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from vispeg.core.errors import UserError

T = TypeVar("T")
KINDS = {  # type of a pydantic error -> the expected value in words
    "model_type": "a mapping of keys to values",
    "dict_type": "a mapping of keys to values",
    "dataclass_type": "a mapping of keys to values",
    "list_type": "a list",
    "tuple_type": "a list",
    "string_type": "text",
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
}
UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")  # types of pydantic's errors for an unknown key


def typed(kind: type[T], data: Any, file: str | Path, key: str = "") -> T:
    """Convert plain data to a type.

    Args:
        kind: a dataclass, a pydantic model, or a type of these.
        data: plain data, as `read_yaml` and `read_json` return it.
        file, key: file and key of the data, for the error.

    Raises:
        UserError: a value of another type, a missing or an unknown key, or values that `kind` itself refuses; it names
            file and key.
    """
    try:
        return _adapter(kind).validate_python(data)
    except ValidationError as error:
        raise as_user_error(error, file, key) from None
    except UserError as error:
        raise UserError(str(error), file=file, key=key or None) from None


def as_user_error(error: ValidationError, file: str | Path, key: str) -> UserError:
    """Return the first of pydantic's errors as a UserError, with the choices if there are any."""
    first = error.errors(include_url=False)[0]
    at = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in first["loc"])
    where = f"{key}{at}".lstrip(".") or None
    context = first.get("ctx", {})
    if first["type"] == "missing":
        return UserError("is missing", file=file, key=where)
    if first["type"] in UNKNOWN:
        return UserError("unknown key", file=file, key=where)
    if first["type"] == "literal_error":
        # pydantic's text is such as "'a', 'b' or 'c'"
        choices = [part.strip(" '") for part in str(context["expected"]).replace(" or ", ", ").split(",")]
        return UserError("is not one of the choices", file=file, key=where, got=first["input"], choices=choices)
    if first["type"] in KINDS:
        return UserError("has the wrong type", file=file, key=where, expected=KINDS[first["type"]], got=first["input"])
    message = first["msg"].removeprefix("Value error, ")
    return UserError(message[:1].lower() + message[1:], file=file, key=where, got=first["input"])


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)
