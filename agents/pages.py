"""Putting printed tables into pages, so that no number in them is copied by hand.

In a page the lines between `<!-- NAME: written by COMMAND -->` and `<!-- end of NAME -->` are a command's.
"""

from __future__ import annotations

import re
from pathlib import Path

from agents.files import write_text


def put(page: Path, name: str, text: str) -> None:
    """Replace what stands between the marks of a name. Raises ValueError where the page has no such marks."""
    before = page.read_text(encoding="utf-8")
    found = _between(before, name)
    if found is None:
        raise ValueError(f"{page} has no marks for {name!r}; allowed is a page with <!-- {name}: ... --> and an end")
    start, end = found
    write_text(page, f"{before[:start]}\n\n{text.strip()}\n\n{before[end:]}")


def read(page: Path, name: str) -> str:
    """What stands between the marks of a name. Raises ValueError where the page has no such marks."""
    text = page.read_text(encoding="utf-8")
    found = _between(text, name)
    if found is None:
        raise ValueError(f"{page} has no marks for {name!r}")
    return text[slice(*found)].strip()


def _between(text: str, name: str) -> tuple[int, int] | None:
    """Where the text between the marks starts and ends."""
    begin = re.search(rf"<!-- {re.escape(name)}: .*? -->", text, re.DOTALL)
    if begin is None:
        return None
    end = re.search(rf"<!-- end of {re.escape(name)} -->", text[begin.end() :])
    return None if end is None else (begin.end(), begin.end() + end.start())
