"""What the scripts have in common: their messages, and the reading of their options."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Callable
from typing import NoReturn

import gymnasium as gym


def run(main: Callable[[], None], interrupted: str = "interrupted") -> None:
    """Call a script's main function; what a user did wrong becomes one line and a status of 2, never a traceback.

    `interrupted` is said after Ctrl-C, or where a training has noticed a signal and saved what it had; then the status
    is 128 plus the signal's number, as shells have it.
    """
    try:
        main()
    except (ValueError, OSError, ArithmeticError, gym.error.Error) as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        raise SystemExit(2) from None
    except MemoryError as error:
        print(f"error: not enough memory {error}", file=sys.stderr)
        raise SystemExit(2) from None
    except KeyboardInterrupt as error:
        print(f"\n{': '.join(filter(None, (str(error), interrupted)))}", file=sys.stderr)
        raise SystemExit(getattr(error, "status", 128 + signal.SIGINT)) from None


def add_changes(parser: argparse.ArgumentParser) -> None:
    """Add --set section.key=value, which may be given many times."""
    parser.add_argument(
        "--set",
        dest="changes",
        action="append",
        default=[],
        metavar="SECTION.KEY=VALUE",
        help="change a setting of the config, for example --set ppo.gamma=0.99; may be given many times",
    )


class Parser(argparse.ArgumentParser):
    """Says in one line what is wrong with the command line, as `run` does of all else."""

    def error(self, message: str) -> NoReturn:
        """End with a status of 2."""
        print(f"error: {message}", file=sys.stderr)
        raise SystemExit(2)
