"""Docstrings here are plain text with single backticks; autodoc reads reStructuredText. This makes one of the other."""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

MANUAL = "The manual of each environment id is made from this class's docstring: see the environments' pages."
COLON = "\N{RATIO}"  # stands for one where napoleon would take what is before it for a type


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
    if what in ("attribute", "property"):
        lines[:] = [line.replace(": ", f"{COLON} ") for line in lines]


def finish(_app: Sphinx, _what: str, _name: str, _object: Any, _options: Any, lines: list[str]) -> None:
    lines[:] = [line.replace(COLON, ":") for line in lines]


def name_aliases(app: Sphinx, _domain: str, _kind: str, _content: Any) -> None:
    """Within other types autodoc shows an alias as the object by which it stands for it; its name is meant."""
    for types in app.env.current_document.autodoc_annotations.values():
        for name, text in types.items():
            types[name] = re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", text)


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("autodoc-process-docstring", mend, priority=400)  # before napoleon looks for sections
    app.connect("autodoc-process-docstring", finish, priority=600)
    app.connect("object-description-transform", name_aliases, priority=400)  # before autodoc writes the types
    return {"parallel_read_safe": True}
