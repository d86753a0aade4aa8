"""Ray on this machine alone, or a running cluster."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
OBJECT_STORE = 256 * 2**20  # bytes: a rollout takes a few MB, and Ray's default is a third of the memory


@contextmanager
def ray_running(address: str | None, processes: int) -> Iterator[None]:
    """Ray while the block runs.

    Arguments:
        address: of a running cluster ("auto": the one that this machine belongs to), to which our packages are sent
            along. None: Ray is started here for the while, with nothing listening beyond this machine.
        processes: how many it may run at once, if it is started here.

    Raises ValueError where Ray isn't installed, or ConnectionError where no cluster answers.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    os.environ.setdefault("RAY_BACKEND_LOG_LEVEL", "fatal")
    if address is None:
        # Ray takes 127.0.0.1 for its node, and then listens nowhere else, where it believes that it can't be a cluster.
        os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
    try:
        import ray
    except ImportError as error:
        raise ValueError(f"ray is not installed ({error}): make ray, or pip install '.[ray]'") from error
    if address is None:
        from ray._private import ray_constants

        ray_constants.ENABLE_RAY_CLUSTER = False  # as above, where Ray was imported before
        ray.init(
            address="local",  # or it would be a cluster's, if this machine belongs to one
            num_cpus=max(processes, 1),
            object_store_memory=OBJECT_STORE,
            include_dashboard=False,
            runtime_env={"env_vars": {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}},
            logging_level=logging.ERROR,
            log_to_driver=False,
        )
    else:
        modules = [str(ROOT / name) for name in ("agents", "spring_pendulum_env")]
        ray.init(
            address=address,
            runtime_env={"py_modules": modules, "env_vars": {"OMP_NUM_THREADS": "1"}},
            logging_level=logging.ERROR,
        )
    logging.getLogger("ray.rllib").setLevel(logging.ERROR)
    try:
        yield
    finally:
        ray.shutdown()
