"""Docstrings here are plain text with single backticks; autodoc reads reStructuredText. This makes one of the other."""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

MANUAL = "The manual of each environment id is made from this class's docstring: see the environments' pages."


def restructured(lines: list[str]) -> list[str]:
    """Lines of a docstring, `names` as ``names`` and what reStructuredText would take for markup escaped.

    Examples are left as they are.
    """
    done = []
    example = False
    for line in lines:
        example = line.lstrip().startswith((">>>", "...")) or (example and bool(line.strip()))
        if example:
            done.append(line)
            continue
        pieces = re.split(r"(``.*?``|`[^`]*`)", line)
        for place, piece in enumerate(pieces):
            if piece.startswith("`"):
                pieces[place] = f"``{piece.strip('`')}``"
            else:
                # A bullet stays one.
                bullet = re.match(r"\s*[*-] ", piece) if place == 0 else None
                start = bullet.end() if bullet else 0
                pieces[place] = piece[:start] + re.sub(r"([*|]|_(?!\w))", r"\\\1", piece[start:])
        done.append("".join(pieces))
    return done


def mend(_app: Sphinx, what: str, name: str, _object: Any, _options: Any, lines: list[str]) -> None:
    if what == "class" and name.endswith(".SpringPendulumEnv"):
        lines[:] = [MANUAL]
        return
    lines[:] = restructured(lines)


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("autodoc-process-docstring", mend, priority=400)  # before napoleon looks for sections
    return {"parallel_read_safe": True}
