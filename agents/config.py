"""What a training is made from: one YAML file, checked before anything starts.

A config holds plain data only. Unknown keys are refused, so that a misspelt setting cannot be ignored in silence, and
so are values of the wrong type and those that cannot be trained with, with the line in which they stand.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, StrictBool, ValidationError, model_validator

from agents.config_errors import Places, nearest, place_of, sentence
from agents.yaml_file import parse_yaml, read_yaml
from spring_pendulum_env import EQUILIBRIA, Parameters
from spring_pendulum_env.scenario import Scenario
from spring_pendulum_env.tasks import TASKS

ENVIRONMENT_IDS = {
    "damping": "SpringPendulumDamping-v0",
    "stabilisation": "SpringPendulumStabilisation-v0",
    "swing-up": "SpringPendulumSwingUp-v0",
}
FOLDER = Path(__file__).resolve().parent.parent / "configs"


def _number(value: Any) -> Any:
    """PyYAML reads `1e6` as text, and pydantic takes `true` for 1: mend the first, refuse the second."""
    if isinstance(value, bool):
        raise ValueError("must be a number")
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            raise ValueError("must be a number") from None
    return value


Count = Annotated[int, BeforeValidator(_number), Field(gt=0)]
Seed = Annotated[int, BeforeValidator(_number), Field(ge=0, lt=2**32)]  # evaluation starts are seeded from 2**40 on
Number = Annotated[float, BeforeValidator(_number), Field(allow_inf_nan=False)]
Positive = Annotated[float, BeforeValidator(_number), Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, BeforeValidator(_number), Field(ge=0, allow_inf_nan=False)]
Share = Annotated[float, BeforeValidator(_number), Field(ge=0, le=1)]


class Section(BaseModel):
    """A part of the file: its keys are known and its values don't change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class EnvironmentConfig(Section):
    """Keyword arguments of gym.make; one that is left out has the environment's own default."""

    parameters: dict[str, Number] | None = None
    equilibrium: str | None = None
    control_period: Positive | None = None
    tolerance: Positive | None = None
    randomise: dict[str, tuple[Number, Number]] | None = None
    start_scale: NonNegative | None = None
    max_force: Positive | None = None
    anchor_travel: Positive | None = None
    actuated_axes: str | None = None

    def arguments(self) -> dict[str, Any]:
        """Keyword arguments for gym.make."""
        return self.model_dump(exclude_none=True)


class TrainingConfig(Section):
    """How much is trained, and how often it is saved."""

    seed: Seed = 0
    steps: Count = 1_000_000
    environments: Annotated[Count, Field(le=1_000_000)] = 128
    checkpoint_every: Count = 200_000  # environment steps
    normalise_reward: StrictBool = True  # of SB3's algorithms
    start_scales: tuple[NonNegative, NonNegative] = (1.0, 1.0)
    """Each start's spread is the environment's times a number drawn evenly from here; shac alone can do it."""
    episode_steps: Count | None = None
    """Episodes are cut off after so many steps, if that is sooner than the environment does it: what is hard lies at
    their beginning, and a value stands for what comes after. For shac alone."""
    starts_along: str | None = None
    """An .npz of `states` (n, 18), a path from where the training is called: some starts lie about one of these, drawn
    evenly, such as states on the way of a plan. For shac alone."""
    starts_along_share: Share = 0.5
    """How many of the starts do so."""


class ObservationConfig(Section):
    """How the relative observations are brought to the size that a network likes.

    By `scales`, one for positions (m) and one for velocities (m/s), or where there are none by the standard deviations
    met in training. Fixed scales can resolve what is near the equilibrium however wild the rest is: where most
    episodes end in a fall, its velocities hide the few centimetres that decide about it.
    """

    scales: tuple[Positive, Positive] | None = None


class NetworkConfig(Section):
    """Hidden layers, of the policy and, apart from it, of the value."""

    layers: Annotated[tuple[Annotated[Count, Field(le=4096)], ...], Field(max_length=8)] = (64, 64)
    activation: Literal["tanh", "relu", "silu"] = "tanh"


class GuideConfig(Section):
    """The LQR to whose action the network's is added: its weights, as `agents.lqr.LQR` takes them."""

    state_weights: tuple[Positive, Positive, Positive, Positive, Positive, Positive]
    effort_weight: Positive


class PPOConfig(Section):
    """Settings of Stable-Baselines3's PPO, under its own names, but for the schedule of the learning rate."""

    learning_rate: Positive = 3e-4
    final_learning_rate: NonNegative = 0.0  # linear from the one above
    n_steps: Annotated[Count, Field(ge=2)] = 64
    batch_size: Annotated[Count, Field(ge=2)] = 2048  # of one number there is no spread to normalise by
    n_epochs: Count = 5
    gamma: Share = 0.99
    gae_lambda: Share = 0.95
    clip_range: Positive = 0.2
    ent_coef: NonNegative = 0.0
    vf_coef: Positive = 0.5
    max_grad_norm: Positive = 0.5
    log_std_init: Number = -1.0


class SACConfig(Section):
    """Settings of Stable-Baselines3's SAC, under its own names. In each round every row takes one step."""

    learning_rate: Positive = 3e-4
    buffer_size: Count = 1_000_000
    learning_starts: Count = 10_000
    batch_size: Count = 512
    tau: Share = 0.005
    gamma: Share = 0.99
    gradient_steps: Count = 8  # in each round


class TQCConfig(SACConfig):
    """Settings of sb3-contrib's TQC, under its own names."""

    top_quantiles_to_drop_per_net: Annotated[Count, Field(lt=25)] = 2  # of 25


class SHACConfig(Section):
    """Settings of short-horizon actor-critic, agents/shac.py. The learning rates fall linearly to a share of them."""

    horizon: Count = 32  # control periods through which a gradient runs; the value stands for all that comes after
    learning_rate: Positive = 2e-3
    critic_learning_rate: Positive = 1e-3
    final_share: Share = 0.03
    gamma: Annotated[Share, Field(lt=1)] = 0.99  # what is largest to be had is divided by
    td_lambda: Share = 0.95
    critic_epochs: Count = 2
    batch_size: Count = 2048
    target_rate: Annotated[float, BeforeValidator(_number), Field(gt=0, le=1)] = 0.5  # of the target after each round
    max_grad_norm: Positive = 1.0


class Config(Section):
    """One training."""

    task: Literal["damping", "stabilisation", "swing-up"]
    algorithm: Literal["ppo", "sac", "tqc", "shac"] = "ppo"
    environment: EnvironmentConfig = EnvironmentConfig()
    training: TrainingConfig = TrainingConfig()
    observation: ObservationConfig = ObservationConfig()
    network: NetworkConfig = NetworkConfig()
    guide: GuideConfig | None = None  # for shac alone
    ppo: PPOConfig = PPOConfig()
    sac: SACConfig = SACConfig()
    tqc: TQCConfig = TQCConfig()
    shac: SHACConfig = SHACConfig()

    @model_validator(mode="after")
    def _fits_the_algorithm(self) -> Config:
        low, high = self.training.start_scales
        if low > high:
            raise ValueError(f"training.start_scales is {(low, high)}: the first must not be larger than the second")
        if self.algorithm == "shac":
            if self.observation.scales is None:
                raise ValueError("observation.scales is missing: shac gathers no statistics of its own")
        elif self.guide is not None:
            raise ValueError(f"guide is given, which {self.algorithm} cannot use: only shac can")
        elif self.training.episode_steps is not None:
            raise ValueError(f"training.episode_steps is given, which {self.algorithm} cannot use: only shac can")
        elif self.training.starts_along is not None:
            raise ValueError(f"training.starts_along is given, which {self.algorithm} cannot use: only shac can")
        elif (low, high) != (1.0, 1.0):
            raise ValueError(
                f"training.start_scales is {(low, high)}, which {self.algorithm} cannot use: only shac can"
            )
        return self

    @property
    def environment_id(self) -> str:
        """Registered name of the task."""
        return ENVIRONMENT_IDS[self.task]

    @property
    def gamma(self) -> float:
        """The discount of the algorithm in use."""
        section: PPOConfig | SACConfig | SHACConfig = getattr(self, self.algorithm)
        return section.gamma

    def to_yaml(self) -> str:
        """Everything, defaults too, as YAML that `read_config` reads."""
        return yaml.safe_dump(self.model_dump(mode="json", exclude_none=True), sort_keys=False)


def default_path(task: str, algorithm: str, equilibrium: str | None = None) -> Path:
    """The file for a task and an algorithm, of an equilibrium if that has its own; ValueError where there is none."""
    own = FOLDER / f"{task}-{equilibrium}-{algorithm}.yaml"
    path = own if equilibrium and own.is_file() else FOLDER / f"{task}-{algorithm}.yaml"
    if not path.is_file():
        allowed = ", ".join(sorted(file.stem for file in FOLDER.glob("*.yaml")))
        raise ValueError(f"there is no config for {path.stem}; allowed are {allowed}")
    return path


def read_config(path: str | Path, changes: Sequence[str] = ()) -> Config:
    """Read and check a YAML file, with `changes` such as "training.seed=3" put over it.

    Raises ValueError, in one line that names file, line, key, value and what is allowed.
    """
    data, lines = read_yaml(Path(path))
    if not isinstance(data, dict):
        allowed = ", ".join(Config.model_fields)
        raise ValueError(f"{path} holds {type(data).__name__}; allowed is a mapping with the keys {allowed}")
    places: Places = {place: f"{path}, line {line}" for place, line in lines.items()}
    for change in changes:
        _apply(data, change, places)
    return check_config(data, source=str(path), places=places)


def check_config(data: Mapping[str, Any], source: str = "config", places: Places | None = None) -> Config:
    """Check plain data. Raises ValueError in one line, which begins with the place in `places`, or with `source`."""
    places = places or {}
    try:
        config = Config.model_validate(data)
    except ValidationError as error:
        raise ValueError("; ".join(sentence(Config, detail, source, places) for detail in error.errors())) from None
    try:
        Scenario.of(TASKS[config.environment_id], **config.environment.arguments())
    except ValueError as error:
        words = str(error)
        name = next((name for name in EnvironmentConfig.model_fields if words.startswith(name)), "parameters")
        hint = nearest(str(config.environment.equilibrium), EQUILIBRIA) if name == "equilibrium" else ""
        for given in (config.environment.parameters, config.environment.randomise):
            for unknown in (given or {}).keys() - set(Parameters.names()):
                hint = hint or nearest(unknown, Parameters.names())
        where = place_of(("environment", name), source, places)
        raise ValueError(f"{where}: environment: {words}{hint}") from None
    return config


def _apply(data: dict[str, Any], change: str, places: Places) -> None:
    """Put one "section.key=value" into nested data, its value read as YAML."""
    name, equals, text = change.partition("=")
    if not equals or not all(name.split(".")):
        raise ValueError(f"change is {change!r}; allowed is section.key=value, for example training.seed=3")
    *sections, key = name.split(".")
    for section in sections:
        inner = data.setdefault(section, {})
        if inner is None:
            inner = data[section] = {}
        if not isinstance(inner, dict):
            raise ValueError(f"change is {change!r}, but {section} is {inner!r} and has no keys")
        data = inner
    data[key], _ = parse_yaml(text, f"change is {change!r}, whose value")
    changed = tuple(name.split("."))
    for place in [place for place in places if place[: len(changed)] == changed]:
        del places[place]
    places[changed] = f"change {change!r}"
