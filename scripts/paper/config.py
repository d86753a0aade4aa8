"""The settings of configs/paper.yaml, checked before anything starts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import AfterValidator, ValidationError

from agents.config import Count, Number, Positive, Section, Seed
from spring_pendulum_env import Parameters

FOLDER = Path(__file__).resolve().parent.parent.parent / "configs"


def _state(numbers: tuple[float, ...]) -> tuple[float, ...]:
    if len(numbers) != 12:
        raise ValueError(f"must have 12 numbers, not {len(numbers)}")
    return numbers


State = Annotated[tuple[Number, ...], AfterValidator(_state)]
"""X1 Y1 Z1 X2 Y2 Z2 in m, then their rates in m/s."""


def _constants(values: dict[str, float]) -> dict[str, float]:
    Parameters.of(values)  # raises a ValueError that names the constant
    return values


Constants = Annotated[dict[str, Number], AfterValidator(_constants)]


class System(Section):
    """A pendulum: those of its constants that aren't the package's defaults."""

    parameters: Constants

    @property
    def constants(self) -> Parameters:
        """All constants, defaults too."""
        return Parameters.of(self.parameters)


class Motion(System):
    """A start, and how ode45 integrates from it."""

    start: State
    rtol: Positive
    atol: Positive


class Run(Motion):
    """A motion over a given time."""

    duration: Positive  # s


class Spinning(Run):
    """A run that is made again with a smaller relative tolerance."""

    finer_rtol: Positive


class Orbit(Motion):
    """A motion that nearly closes: a guess of a periodic one."""

    period: Positive  # s
    periods: Count


class ElasticPendulum(System):
    """One spring with gravity."""

    energy: Number  # J
    starts: tuple[tuple[Number, Number], ...]  # Z1 in m, VZ1 in m/s
    section_duration: Positive  # s
    in_space: State
    vertical_amplitude: Positive  # m


class NoGravity(System):
    """One spring without gravity."""

    distance: Positive  # m
    speeds: tuple[Positive, ...]  # m/s


class Resistance(System):
    """Starts that air resistance brings to rest."""

    starts: Count
    duration: Positive  # s
    seed: Seed


class Lyapunov(Section):
    """How long exponents are averaged."""

    duration: Positive  # s
    transient: Positive  # s


class Config(Section):
    """All of configs/paper.yaml."""

    spinning: Spinning
    chaotic: Run
    periodic: Orbit
    single: Orbit
    elastic_pendulum: ElasticPendulum
    no_gravity: NoGravity
    resistance: Resistance
    lyapunov: Lyapunov

    def quick(self) -> Config:
        """The same with less of everything, to see that it works: no result of it means much."""
        pendulum, gravity, air = self.elastic_pendulum, self.no_gravity, self.resistance
        return self.model_copy(
            update={
                "elastic_pendulum": pendulum.model_copy(
                    update={"starts": pendulum.starts[:3], "section_duration": 50.0}
                ),
                "no_gravity": gravity.model_copy(update={"speeds": gravity.speeds[:3]}),
                "resistance": air.model_copy(update={"starts": 3}),
                "lyapunov": Lyapunov(duration=200.0, transient=50.0),
            }
        )


def read_config(path: Path = FOLDER / "paper.yaml") -> Config:
    """Read and check a YAML file.

    Raises:
        ValueError: in one line that names the file, the key, its value and what is allowed.
    """
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(data, dict):
        raise ValueError(f"{path} holds {type(data).__name__}; must be a mapping of {', '.join(Config.model_fields)}")
    try:
        return Config.model_validate(data)
    except ValidationError as error:
        raise ValueError("; ".join(f"{path}: {_sentence(detail)}" for detail in error.errors())) from None


def _sentence(detail: Any) -> str:
    """One of pydantic's complaints in our words."""
    key = ".".join(str(part) for part in detail["loc"])
    if detail["type"] == "missing":
        return f"{key} is missing"
    if detail["type"] == "extra_forbidden":
        section: Any = Config
        for part in detail["loc"][:-1]:
            section = section.model_fields[part].annotation
        return f"{key} is not a setting; allowed are {', '.join(section.model_fields)}"
    return f"{key} = {detail['input']!r}: {detail['msg'].removeprefix('Value error, ').lower()}"
