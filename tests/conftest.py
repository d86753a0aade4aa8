"""Options of the tests."""

from __future__ import annotations

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--kills", type=int, default=2, help="times that test_survival.py kills each kind of training")
    parser.addoption("--kill-seed", type=int, default=0, help="of the random moments")
