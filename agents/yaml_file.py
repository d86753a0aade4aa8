"""YAML as plain data, with the line of each key, and without the parts of YAML that surprise or explode."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

LARGEST = 1_000_000
"""Bytes of a file, at most."""

DEEPEST = 20
"""Levels of nesting, at most."""

Place = tuple[str | int, ...]
"""Keys and indices on the way to a value."""


class _Loader(yaml.SafeLoader):
    """No tags beyond plain data, no aliases (a few lines of them stand for billions of values), no key twice."""

    depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()  # type: ignore[no-untyped-call]
            raise yaml.composer.ComposerError(None, None, f"alias *{event.anchor}, allowed are none", event.start_mark)
        self.depth += 1
        if self.depth > DEEPEST:
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.composer.ComposerError(None, None, "nested too deep", mark)
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        first: dict[str, Any] = {}
        for key, _ in node.value:
            mark = first.setdefault(str(key.value), key.start_mark)
            if mark is not key.start_mark:
                problem = f"{key.value} is there twice, first in line {mark.line + 1}"
                raise yaml.constructor.ConstructorError(None, None, problem, key.start_mark)
        return super().construct_mapping(node, deep)


def read_yaml(path: Path) -> tuple[Any, dict[Place, int]]:
    """A file's plain data, and the line in which each key or item stands.

    Raises ValueError in one line that names the file where it can't be read or is something else.
    """
    try:
        if path.is_dir() or path.stat().st_size > LARGEST:
            raise ValueError(f"{path} is no file of at most {LARGEST:,} bytes")
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not YAML: {error}") from error
    return parse_yaml(text, str(path))


def parse_yaml(text: str, source: str) -> tuple[Any, dict[Place, int]]:
    """The same for a text that comes from `source`."""
    try:
        loader = _Loader(text)
        loader.name = source
        node = loader.get_single_node()
        data = None if node is None else loader.construct_document(node)
        return data, dict(_lines(node, ()))
    except (yaml.YAMLError, ValueError) as error:  # a date or a number that is none
        raise ValueError(f"{source} is not YAML of plain data: {' '.join(str(error).split())}") from None


def _lines(node: Any, place: Place) -> Iterator[tuple[Place, int]]:
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            yield (*place, str(key.value)), key.start_mark.line + 1
            yield from _lines(value, (*place, str(key.value)))
    elif isinstance(node, yaml.SequenceNode):
        for index, value in enumerate(node.value):
            yield (*place, index), value.start_mark.line + 1
            yield from _lines(value, (*place, index))
