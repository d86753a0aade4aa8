"""What is wrong with a config, in one line: where, which setting and value, what is allowed, and what may be meant."""

from __future__ import annotations

import difflib
import typing
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import BaseModel

Places = dict[tuple[str | int, ...], str]
"""Where a setting was read, in words, by the keys on the way to it."""

LONGEST = 100
"""Characters of a value that are shown."""


def sentence(config: type[BaseModel], detail: Mapping[str, Any], source: str, places: Places) -> str:
    """One of pydantic's complaints in our words."""
    loc = tuple(detail["loc"])
    key = ".".join(str(part) for part in loc)
    where = place_of(loc, source, places)
    message = detail["msg"].removeprefix("Value error, ")
    if not key:  # of the config as a whole, in words of its own, which begin with the setting's name
        return f"{place_of(tuple(message.split()[0].split('.')), source, places)}: {message}"
    if detail["type"] == "extra_forbidden":
        section = _section(config, loc[:-1])
        hint = nearest(str(loc[-1]), section.model_fields) or nearest(str(loc[-1]), _all_settings(config), 0.8)
        return f"{where}: {key} is not a setting{hint}; allowed are {', '.join(section.model_fields)}"
    if detail["type"] == "missing":
        return f"{where}: {key} is missing"
    shown = repr(detail["input"])
    shown = shown if len(shown) <= LONGEST else f"{shown[:LONGEST]}..."
    hint = ""
    if detail["type"] == "literal_error":
        allowed = detail["ctx"]["expected"].replace(" or ", ", ").replace("'", "").split(", ")
        hint = nearest(str(detail["input"]), allowed)
    return f"{where}: {key} is {shown}: {message[0].lower()}{message[1:]}{hint}"


def place_of(loc: tuple[str | int, ...], source: str, places: Places) -> str:
    """Where a setting, or else what it is in, was read."""
    for length in range(len(loc), 0, -1):
        if loc[:length] in places:
            return places[loc[:length]]
    return source


def nearest(name: str, allowed: Iterable[str], likeness: float = 0.6) -> str:
    """A question whether something similar was meant; nothing where nothing is similar."""
    by_last = {full.rpartition(".")[2]: full for full in reversed(list(allowed))}
    found = difflib.get_close_matches(name, by_last, n=1, cutoff=likeness)
    return f" (did you mean {by_last[found[0]]}?)" if found and by_last[found[0]] != name else ""


def _section(config: type[BaseModel], loc: tuple[str | int, ...]) -> type[BaseModel]:
    """The section at a place."""
    section = config
    for part in loc:
        section = _section_in(section.model_fields[str(part)].annotation) or section
    return section


def _section_in(annotation: Any) -> type[BaseModel] | None:
    for kind in (annotation, *typing.get_args(annotation)):
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return kind
    return None


def _all_settings(config: type[BaseModel]) -> list[str]:
    """All settings of all sections, as section.key."""
    return [
        f"{name}.{key}"
        for name, field in config.model_fields.items()
        for key in getattr(_section_in(field.annotation), "model_fields", {})
    ]
