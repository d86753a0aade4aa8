"""Tools for the dynamics of the passive pendulum: exponents, sections, periodic orbits, maps of chaos.

Each name is imported on first use, and numba with it. Normal modes are `spring_pendulum_env.normal_modes`.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from spring_pendulum_env.dynamics.along import (
        Quantities,
        quantities,
    )
    from spring_pendulum_env.dynamics.chaos import (
        ChaosMap,
        chaos_map,
        thrown_straight,
    )
    from spring_pendulum_env.dynamics.energy_surface import (
        lowest_state,
        microcanonical_starts,
    )
    from spring_pendulum_env.dynamics.lyapunov import (
        LyapunovExponent,
        LyapunovSpectrum,
        lyapunov_exponent,
        lyapunov_exponents,
        lyapunov_spectrum,
    )
    from spring_pendulum_env.dynamics.megno import (
        Indicators,
        chaos_indicators,
        mean_megno,
    )
    from spring_pendulum_env.dynamics.orbits import (
        NotPeriodicError,
        PeriodicOrbit,
        monodromy_matrix,
        periodic_orbit,
    )
    from spring_pendulum_env.dynamics.sections import (
        COORDINATES,
        Crossings,
        NotCrossedError,
        Section,
        poincare_section,
    )

_MODULES = {
    "along": ("Quantities", "quantities"),
    "chaos": ("ChaosMap", "chaos_map", "thrown_straight"),
    "energy_surface": ("lowest_state", "microcanonical_starts"),
    "lyapunov": (
        "LyapunovExponent",
        "LyapunovSpectrum",
        "lyapunov_exponent",
        "lyapunov_exponents",
        "lyapunov_spectrum",
    ),
    "megno": ("Indicators", "chaos_indicators", "mean_megno"),
    "orbits": ("NotPeriodicError", "PeriodicOrbit", "monodromy_matrix", "periodic_orbit"),
    "sections": ("COORDINATES", "Crossings", "NotCrossedError", "Section", "poincare_section"),
}

__all__ = [
    "COORDINATES",
    "ChaosMap",
    "Crossings",
    "Indicators",
    "LyapunovExponent",
    "LyapunovSpectrum",
    "NotCrossedError",
    "NotPeriodicError",
    "PeriodicOrbit",
    "Quantities",
    "Section",
    "chaos_indicators",
    "chaos_map",
    "lowest_state",
    "lyapunov_exponent",
    "lyapunov_exponents",
    "lyapunov_spectrum",
    "mean_megno",
    "microcanonical_starts",
    "monodromy_matrix",
    "periodic_orbit",
    "poincare_section",
    "quantities",
    "thrown_straight",
]


def __getattr__(name: str) -> Any:
    for module, names in _MODULES.items():
        if name in names:
            return getattr(importlib.import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
