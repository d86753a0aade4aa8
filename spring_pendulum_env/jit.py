"""How the package's numeric functions are compiled, and where the results are cached."""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
from numba import types
from numba.extending import intrinsic, register_jitable

from spring_pendulum_env import integrators, physics, tasks

FOLDER = Path(__file__).parent
COMPILED = ("physics", "equilibria", "integrators", "tasks", "scenario", "layout", "jit", "schemes", "kernels")
"""Modules whose functions and constants are compiled, besides those of `dynamics`."""


def _source_hash() -> str:
    """Changes with any source that may be compiled: numba's own cache key doesn't see edits in other files."""
    sources = (FOLDER / f"{name}.py" for name in COMPILED)
    text = b"".join(path.read_bytes() for path in (*sources, *sorted((FOLDER / "dynamics").glob("*.py"))))
    return hashlib.sha256(text).hexdigest()[:16]


@contextlib.contextmanager
def cache_folder() -> Iterator[bool]:
    """Sets numba's cache folder while functions are declared; yields whether there is one that can be written.

    It is NUMBA_CACHE_DIR, or else a folder of this version of the sources beside the package's other compiled files,
    in place of those of versions before.
    """
    own = FOLDER / "__pycache__"
    folder = Path(os.environ.get("NUMBA_CACHE_DIR") or own) / f"kernels-{_source_hash()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK)
    except OSError:
        writable = False
    for old in own.glob("kernels-*"):
        if old.name != folder.name:
            shutil.rmtree(old, ignore_errors=True)
    before = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    if writable:
        numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
    try:
        yield writable
    finally:
        numba.config.CACHE_DIR = before  # type: ignore[attr-defined]


def compiled(function: Callable[..., Any]) -> Any:
    """Compiled by itself, with the entries that call it, and cached with them."""
    dispatcher: Any = numba.njit(error_model="numpy", nogil=True)(function)
    return dispatcher


def compiled_for_width(function: Callable[..., Any]) -> Any:
    """As `compiled`, for functions of a buffer, its width, and how many lanes of it are in use.

    They begin with `literally(width)` and a test of the buffer's width that never fails: these tell the compiler the
    distances between the buffer's fields, without which it would not vectorise. The lanes are one, or a multiple of
    eight, so that no loop has a remainder. Written into one big function instead, the parts would take numba several
    times as long.
    """
    return compiled(function)


def _floats_at(_typing: Any, _address: Any) -> Any:
    """For compiled code: an address as a pointer to float64 numbers, of which `numba.carray` makes an array.

    The address is a float64, which holds all that a process can have: Python's float is handed over faster than an int.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        number = builder.fptoui(arguments[0], context.get_value_type(types.uintp))
        return builder.inttoptr(number, context.get_value_type(signature.return_type))

    return types.CPointer(types.float64)(types.float64), generate  # type: ignore[no-untyped-call]


def _floats_at_in_python(address: float) -> Any:
    return ctypes.cast(int(address), ctypes.POINTER(ctypes.c_double))


DISABLED: bool = bool(numba.config.DISABLE_JIT)  # type: ignore[attr-defined]
"""Whether NUMBA_DISABLE_JIT=1 has everything run in plain Python, to be debugged or traced, a thousand times slower."""

floats_at: Any = _floats_at_in_python if DISABLED else intrinsic(_floats_at)
carray: Any = numba.carray  # type: ignore[attr-defined]


for _function in (
    physics.length,
    physics.spring_force,
    physics.accelerations_under,
    physics.accelerations,
    physics.derivatives,
    physics.weighted_squares,
    physics.spring_energy,
    physics.kinetic_energy,
    physics.potential_energy,
    physics.total_energy,
    physics.energy_error,
    tasks.reward_terms,
    tasks.displaced,
    integrators.approaches_zero,
):
    register_jitable(error_model="numpy")(_function)
