"""Plain data and tensors in torch's own file format, read without running what a file says.

`torch.save` writes a zip: tensors as raw bytes, and a pickle that says how they belong together. `torch.load` runs
that pickle; with `weights_only` it does so carefully, which has been got round nevertheless (CVE-2025-32434, up to
torch 2.5). Here the pickle is only read, as the few instructions that `torch.save` writes for dictionaries, lists,
tuples, numbers, texts and tensors; whatever else is met, the file is refused. Nothing is called, and nothing takes much
more memory than the file has bytes.
"""

from __future__ import annotations

import io
import math
import pickletools
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from agents.files import check_archive, write_atomically

LARGEST_STRUCTURE = 4_000_000
"""Bytes of the pickle, at most; a checkpoint's has some ten thousand."""

_STORAGES = {
    "torch FloatStorage": np.float32,
    "torch DoubleStorage": np.float64,
    "torch LongStorage": np.int64,
    "torch IntStorage": np.int32,
    "torch ByteStorage": np.uint8,
    "torch BoolStorage": np.bool_,
}
_TENSOR = "torch._utils _rebuild_tensor_v2"
_MAPPING = "collections OrderedDict"


def write(path: Path, content: Any) -> None:
    """Write dictionaries, lists, tuples, numbers, texts, tensors and arrays atomically."""
    # Into memory first: torch answers a full disk with an error of its own about something else.
    buffer = io.BytesIO()
    torch.save(_plain(content), buffer)
    write_atomically(path, lambda file: file.write(buffer.getbuffer()))


def read(path: Path) -> Any:
    """What `write`, or `torch.save` of plain data, has put there; tensors in memory of their own.

    Raises ValueError where the file is something else, damaged, or doctored; OSError where it can't be read.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            check_archive(archive, path)
            return _read(archive)
    except (ValueError, TypeError, LookupError, AttributeError, EOFError, RuntimeError, zipfile.BadZipFile) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path} is not a file of weights and plain data: {reason}") from None


def _read(archive: zipfile.ZipFile) -> Any:
    structures = [name for name in archive.namelist() if name.split("/")[1:] == ["data.pkl"]]
    if len(structures) != 1:
        raise ValueError("it has no data.pkl, or more than one")
    prefix = structures[0].removesuffix("data.pkl")
    if archive.getinfo(structures[0]).file_size > LARGEST_STRUCTURE:
        raise ValueError(f"its data.pkl is larger than {LARGEST_STRUCTURE:,} bytes")
    if f"{prefix}byteorder" in archive.namelist() and archive.read(f"{prefix}byteorder") != b"little":
        raise ValueError("its numbers are big-endian")
    kept: dict[tuple[str, str], torch.Tensor] = {}

    def storage(kind: str, key: str, count: int) -> torch.Tensor:
        """All the numbers of one entry, read once."""
        if (kind, key) not in kept:
            if any(key == other for _, other in kept):
                raise ValueError(f"its entry {key} is used for two kinds of numbers")
            entry, size = archive.getinfo(f"{prefix}data/{key}"), np.dtype(_STORAGES[kind]).itemsize
            if entry.file_size != count * size:
                raise ValueError(f"its entry {key} has {entry.file_size:,} bytes, and {count * size:,} are declared")
            values: NDArray[Any] = np.frombuffer(archive.read(entry), dtype=_STORAGES[kind])
            kept[kind, key] = torch.from_numpy(values.copy())
        return kept[kind, key]

    return _Reader(storage).read(archive.read(structures[0]))


class _Word:
    """A name in the pickle: of a class or function that stays a name."""

    def __init__(self, name: str) -> None:
        self.name = name


class _Storage:
    """What a tensor's numbers are part of: name of the kind, of the entry, and how many there are."""

    def __init__(self, marked: Any) -> None:
        kind_of_thing, kind, key, _, count = marked
        if kind_of_thing != "storage" or not isinstance(kind, _Word) or kind.name not in _STORAGES:
            raise ValueError("it refers to something that is no storage")
        if not isinstance(key, str) or not key.isdecimal() or not isinstance(count, int):
            raise ValueError("it refers to a storage in an unknown way")
        self.kind, self.key, self.count = kind.name, key, count


class _Reader:
    """Reads a pickle's instructions, with `storage(kind, key, count)` to get numbers from."""

    def __init__(self, storage: Callable[[str, str, int], torch.Tensor]) -> None:
        self._storage = storage
        self._stack: list[Any] = []
        self._marks: list[int] = []
        self._memo: dict[int, Any] = {}

    def read(self, data: bytes) -> Any:
        for opcode, argument, _ in pickletools.genops(data):
            self._take(opcode.name, argument)
        (result,) = self._stack
        return result

    def _take(self, name: str, argument: Any) -> None:
        stack = self._stack
        match name:
            case "PROTO" | "STOP":
                pass
            case "MARK":
                self._marks.append(len(stack))
            case "NONE":
                stack.append(None)
            case "NEWTRUE" | "NEWFALSE":
                stack.append(name == "NEWTRUE")
            case "BININT" | "BININT1" | "BININT2" | "LONG1" | "BINFLOAT" | "BINUNICODE" | "SHORT_BINUNICODE":
                stack.append(argument)
            case "BINPUT" | "LONG_BINPUT":
                self._memo[argument] = stack[-1]
            case "BINGET" | "LONG_BINGET":
                kept = self._memo[argument]
                if not isinstance(kept, str | _Word):  # a few lists of the same lists would be endless to walk through
                    raise ValueError("it uses the same part twice")
                stack.append(kept)
            case "EMPTY_TUPLE":
                stack.append(())
            case "EMPTY_LIST":
                stack.append([])
            case "EMPTY_DICT":
                stack.append({})
            case "TUPLE":
                stack.append(tuple(self._marked()))
            case "TUPLE1" | "TUPLE2" | "TUPLE3":
                count = int(name[-1])
                stack[-count:] = [tuple(stack[-count:])]
            case "APPEND":
                self._extend([stack.pop()])
            case "APPENDS":
                self._extend(self._marked())
            case "SETITEM":
                value, key = stack.pop(), stack.pop()
                self._update([key, value])
            case "SETITEMS":
                self._update(self._marked())
            case "GLOBAL":
                if argument not in _STORAGES and argument not in (_TENSOR, _MAPPING):
                    raise ValueError(f"it names {argument!r}, which is neither plain data nor a tensor")
                stack.append(_Word(argument))
            case "BINPERSID":
                stack.append(_Storage(stack.pop()))
            case "REDUCE":
                arguments, function = stack.pop(), stack.pop()
                stack.append(self._made(function, arguments))
            case "BUILD":  # attributes, such as the version that a state_dict carries
                stack.pop()
            case _:
                raise ValueError(f"it has the instruction {name}, which plain data needs not")

    def _marked(self) -> list[Any]:
        start = self._marks.pop()
        values = self._stack[start:]
        del self._stack[start:]
        return values

    def _extend(self, values: list[Any]) -> None:
        if not isinstance(self._stack[-1], list):
            raise ValueError("it appends to something that is no list")
        self._stack[-1].extend(values)

    def _update(self, values: list[Any]) -> None:
        if not isinstance(self._stack[-1], dict):
            raise ValueError("it sets items of something that is no dictionary")
        for key, value in zip(values[::2], values[1::2], strict=True):
            if not isinstance(key, str | int):
                raise ValueError("it has a key that is neither a text nor an integer")
            self._stack[-1][key] = value

    def _made(self, function: Any, arguments: Any) -> Any:
        """A dictionary, or a tensor out of (storage, offset, shape, strides, ...)."""
        name = function.name if isinstance(function, _Word) else None
        if name == _MAPPING and arguments == ():
            return {}
        if name != _TENSOR:
            raise ValueError("it calls something that makes no tensor")
        storage, offset, shape, strides = arguments[:4]
        if not isinstance(storage, _Storage) or not all(isinstance(n, int) and n >= 0 for n in (offset, *shape)):
            raise ValueError("it has a tensor without a storage or with an impossible shape")
        count = math.prod(shape)
        if count > 1 and not _in_one_piece(shape, strides):
            raise ValueError(f"it has a tensor of shape {shape} with strides {strides}, which isn't in one piece")
        if offset + count > storage.count:
            raise ValueError(f"it has a tensor of shape {shape}, for which its storage of {storage.count} is too small")
        return self._storage(storage.kind, storage.key, storage.count)[offset : offset + count].reshape(shape)


def _in_one_piece(shape: tuple[int, ...], strides: tuple[int, ...]) -> bool:
    """Whether a tensor's numbers stand in memory one after another, the last axis first."""
    steps = [math.prod(shape[axis + 1 :]) for axis in range(len(shape))]
    return all(size == 1 or step == stride for size, step, stride in zip(shape, steps, strides, strict=True))


def _plain(content: Any) -> Any:
    """Arrays as tensors, numbers of NumPy as Python's, mappings as dictionaries."""
    if isinstance(content, dict):
        return {key: _plain(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return type(content)(_plain(value) for value in content)
    if isinstance(content, np.generic):
        return content.item()
    if isinstance(content, np.ndarray):
        return torch.from_numpy(np.asarray(content, order="C"))
    if isinstance(content, torch.Tensor):
        return content.detach().contiguous()
    return content
