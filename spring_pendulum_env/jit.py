"""How the package's numeric functions are compiled, and where the results are cached."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
from numba import types
from numba.extending import overload, register_jitable

from spring_pendulum_env import integrators, physics, tasks
from spring_pendulum_env.physics import Scalar

FOLDER = Path(__file__).parent
COMPILED = ("physics", "equilibria", "integrators", "tasks", "scenario", "layout", "jit")
"""Modules whose functions and constants are compiled, besides those of the packages `kernels` and `dynamics`."""


def _source_hash() -> str:
    """Changes with any source that may be compiled: numba's own cache key doesn't see edits in other files."""
    sources = (FOLDER / f"{name}.py" for name in COMPILED)
    packages = (path for name in ("kernels", "dynamics") for path in sorted((FOLDER / name).glob("*.py")))
    text = b"".join(path.read_bytes() for path in (*sources, *packages))
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
    """Compiled by itself, with the entries that call it, and cached with them; not to be called from Python."""
    if DISABLED:
        return function
    options: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}  # which take a tenth of the time
    return numba.njit(error_model="numpy", nogil=True, **options)(function)


def compiled_entry(function: Callable[..., Any], nogil: bool = True) -> Any:
    """Compiled when it is first called from Python, and cached; `nogil` lets other threads run meanwhile."""
    with cache_folder() as cached:
        options: dict[str, Any] = {"nogil": nogil, "cache": cached}
        if not DISABLED:
            options["no_cfunc_wrapper"] = True
        njit: Any = numba.njit  # whose stubs don't know all of its options
        return njit(error_model="numpy", **options)(function)


DISABLED: bool = bool(numba.config.DISABLE_JIT)  # type: ignore[attr-defined]
"""Whether NUMBA_DISABLE_JIT=1 has everything run in plain Python, to be debugged or traced, a thousand times slower."""


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


@overload(physics.nonzero, jit_options={"error_model": "numpy"})
def _nonzero(number: Scalar) -> Scalar:
    """Of a float the same as a choice: two of the processor's instructions instead of six."""

    def choice(number: Scalar) -> Scalar:
        return number if number != 0.0 else 1.0

    return choice if isinstance(number, types.Float) else physics.nonzero
