"""A claim of the paper, and what became of it."""

from __future__ import annotations

import dataclasses
from typing import Literal

Verdict = Literal["holds", "holds with a condition", "fails"]


@dataclasses.dataclass(frozen=True)
class Claim:
    """What the paper says somewhere, whether it is so, and what shows it."""

    section: str
    """Where: the section's number, and the figure's."""
    says: str
    verdict: Verdict
    evidence: str


FITTED = True
"""An exception to each claim about printed numbers: the paper has no constants or starts, so it is so with ours."""


def judged(true: bool, *, exceptions: bool = False) -> Verdict:
    """The verdict on a claim.

    Args:
        true: it was found to be so where the paper has it, or under the condition that the evidence names.
        exceptions: and not so elsewhere, where the paper has it too.
    """
    if not true:
        return "fails"
    return "holds with a condition" if exceptions else "holds"


def near(found: float, printed: float, share: float = 0.15) -> bool:
    """Whether a number that fitted constants give is as near to a printed one as the fit could make it."""
    return abs(found - printed) <= share * abs(printed)
