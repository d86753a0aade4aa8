"""What the order-chaos-order study is made from: one YAML file, checked before anything starts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import yaml
from pydantic import Field, ValidationError

from agents.config import Count, Number, Positive, Section, Seed, Share

DEFAULT = Path(__file__).resolve().parent.parent.parent / "configs" / "dynamics" / "order-chaos-order.yaml"

QUICK = {"starts": 24, "duration": 200.0}
"""What --quick changes: all points, coarsely."""

Positives = Annotated[tuple[Positive, ...], Field(min_length=1)]


class EnergyPanel(Section):
    """Share against energy."""

    stiffness: Positive
    energies: Positives


class StiffnessPanel(Section):
    """Share against stiffness."""

    energy: Positive
    stiffnesses: Positives


class Study(Section):
    """All settings."""

    seed: Seed
    parameters: dict[str, Number] = Field(default_factory=dict)
    starts: Count
    duration: Positive
    least_agreement: Share
    energy_panel: EnergyPanel
    stiffness_panel: StiffnessPanel

    def to_yaml(self) -> str:
        """Everything, as YAML that `read_study` reads."""
        return yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False)


def read_study(path: Path = DEFAULT, quick: bool = False) -> Study:
    """Read and check a YAML file.

    Raises:
        ValueError: in one line that names the file, key, value and what is allowed.
    """
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
    if not isinstance(data, dict):
        raise ValueError(f"{path} holds {type(data).__name__}; allowed is a mapping of {', '.join(Study.model_fields)}")
    try:
        study = Study.model_validate({**data, **(QUICK if quick else {})})
    except ValidationError as error:
        faults = (
            f"{path}: {'.'.join(map(str, fault['loc']))} = {fault['input']!r}: {fault['msg']}"
            for fault in error.errors()
        )
        raise ValueError("; ".join(faults)) from None
    for name in ("k1", "k2"):
        if name in study.parameters:
            raise ValueError(f"{path}: parameters.{name} = {study.parameters[name]!r}: the panels set the stiffness")
    return study
