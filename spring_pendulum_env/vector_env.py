"""Many pendulums at once: rows, automatic resets, the time limit, and nothing else."""

from __future__ import annotations

import concurrent.futures
import itertools
import os
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Unpack

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from spring_pendulum_env import layout
from spring_pendulum_env.env import checked_render_options, failure
from spring_pendulum_env.equilibria import BODY_STATE
from spring_pendulum_env.kernels import batch
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.scenario import Arguments, Scenario, real_numbers
from spring_pendulum_env.starts import Starts
from spring_pendulum_env.tasks import REWARD_TERMS, task_named
from spring_pendulum_env.vector_arguments import (
    checked_options,
    mode_of,
    of_row,
    positive_integer,
    rows_of,
    seeds_of,
    some,
)

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

BOOL = np.dtype(np.bool_)  # of which an array is made faster than of the type
FLOAT32 = np.dtype(np.float32)

# Names of the infos that are numbers, as they stand among the outcomes of a step; after them those of the reward terms.
_NUMBERS = {
    layout.TIME: "time",
    layout.ENERGY: "energy",
    layout.EXCESS: "excess_energy",
    layout.ERROR: "energy_error",
    layout.WORK_DONE: "work",
    layout.LOST_TO_DRAG: "dissipated",
}


class SpringPendulumVectorEnv(VectorEnv[FloatArray, Any, Any]):
    """`num_envs` pendulums, integrated, observed, rewarded and ended by one call of the compiled step.

    `gym.make_vec(id, num_envs=N, ...)` makes it; the arguments are those of `SpringPendulumEnv`, and those below. Each
    row gives the bits that a single environment gives with the same seed and actions; row i of `reset(seed=s)` is a
    single environment's `reset(seed=s + i)`.

    Infos have Gymnasium's vector form: arrays of shape (num_envs, ...), and for each key a mask `_key` of the rows that
    have it. The arrays of `parameters` and the masks are read-only, since they are handed out again as long as no row
    starts anew.

    Args:
        num_envs: rows.
        max_episode_steps: after so many steps a row is truncated; None: never.
        autoreset_mode: `NEXT_STEP` (the step after an ended one resets the row), `SAME_STEP` (the ending step returns
            the new start, and the end as `final_obs` and `final_info`), or `DISABLED`
            (`reset(options={"reset_mask": ...})` says which rows to reset). A mode or its name.
        threads: how many threads share the rows; the bits don't depend on it.
        render_rows: rows that `render` draws; None: all.
        render_options: as those of `SpringPendulumEnv`, the same for all rows.

    Raises:
        ValueError: a wrong argument.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": 50,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int,
        task: str,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 1,
        render_rows: Sequence[int] | None = None,
        render_mode: str | None = None,
        render_options: Mapping[str, Any] | None = None,
        **arguments: Unpack[Arguments],
    ) -> None:
        # These first, since `close` is called even of an environment whose arguments were refused.
        self._renderers: dict[int, Any] = {}
        self._pool: concurrent.futures.ThreadPoolExecutor | None = None
        self._pool_process = 0
        self.scenario = Scenario.of(task_named(task), **arguments)
        self.num_envs = num_envs = positive_integer("num_envs", num_envs)
        self.threads = positive_integer("threads", threads)
        self.max_episode_steps: float = np.inf
        if max_episode_steps is not None:
            self.max_episode_steps = positive_integer("max_episode_steps", max_episode_steps)
        self.autoreset_mode = mode_of(autoreset_mode)
        self._same_step = self.autoreset_mode == AutoresetMode.SAME_STEP
        self._adaptive = self.scenario.tolerance is not None
        self._actuated = self.scenario.task.actuated
        self._state_size = self.scenario.state_size
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode = {render_mode!r}: must be None or 'rgb_array'")
        self.render_mode = render_mode
        self._render_options = checked_render_options(render_options)
        self.render_rows = range(self.num_envs) if render_rows is None else rows_of(render_rows, self.num_envs)
        self.metadata = {
            **self.metadata,
            "render_fps": max(1, round(1.0 / self.scenario.control_period)),
            "autoreset_mode": self.autoreset_mode,
        }
        self.single_observation_space = spaces.Box(-np.inf, np.inf, (self.scenario.state_size,), np.float64)
        self.single_action_space = spaces.Box(-1.0, 1.0, (len(self.scenario.actuated_axes),), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

        self._settings = layout.settings_of(self.scenario, self.max_episode_steps)
        self._template = layout.template(self.scenario, self.scenario.parameters)
        self._rows = np.zeros((-(-num_envs // layout.WIDTH), layout.FIELDS, layout.WIDTH))
        self._shares = _shares(num_envs, self.threads)
        self._numbers = [_NUMBERS[place] for place in sorted(_NUMBERS)]
        if self.scenario.task.actuated:
            self._numbers += [f"reward_{term}" for term in REWARD_TERMS]
        self._starts = Starts(num_envs, ahead=not self.scenario.randomise)
        self._usual_start = np.concatenate([self._template, self.scenario.spread])
        self._usual_start[layout.STATE : layout.STATE + 18] = self.scenario.start
        self._constants = {name: np.full(num_envs, value) for name, value in self.scenario.parameters.as_dict().items()}
        self._unusual: BoolArray = np.zeros(num_envs, dtype=np.bool_)  # rows whose constants are drawn or set
        self._look_for_unusual()
        self._shown_constants: dict[str, FloatArray | BoolArray] | None = None
        self._no_actions = np.zeros((num_envs, len(self.scenario.actuated_axes)))
        self._actions = self._no_actions.copy()
        self._all = _read_only(np.ones(num_envs, dtype=np.bool_))
        told = [*self._numbers, "parameters"] + ["force"] * self.scenario.task.actuated
        # The keys of the infos in their order, each with what a mask of all rows is: much of a step's infos.
        self._told: dict[str, Any] = dict.fromkeys((key for name in told for key in (name, f"_{name}")), self._all)
        self._ended: BoolArray = np.zeros(num_envs, dtype=np.bool_)  # written by the compiled step
        self._kept = (self._ended, self._usual_start, self._starts.numbers, self._starts.taken, self._settings)
        self._started = False
        # Whether rows that end start anew as usual, in the next step, by the splitting; and whether each has a start.
        self._usual_restarts = (
            self.autoreset_mode == AutoresetMode.NEXT_STEP
            and self.scenario.tolerance is None
            and not self.scenario.randomise
        )
        self._starts_ready = False

    @property
    def states(self) -> FloatArray:
        """The states with the anchor, shape (num_envs, 18), whatever the observations show of them; a copy."""
        states = self._rows[:, layout.STATE : layout.STATE + 18].transpose(0, 2, 1)
        return states.reshape(-1, 18)[: self.num_envs].copy()

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Starts an episode in every row, or in those of `options["reset_mask"]`.

        Args:
            seed: row i is seeded with seed + i, or with the i-th of a sequence; None goes on with the random numbers.
            options: "state", shape (12 or 18,), or one such row for each; "parameters", of numbers, or arrays with one
                number for each row; "reset_mask", a boolean array of the rows to reset.

        Returns:
            Observations of all rows, and infos of those that were reset.

        Raises:
            ValueError: a wrong seed or option; nothing is reset then.
            ResetNeeded: a reset_mask before all rows were reset.
        """
        seeds = seeds_of(seed, self.num_envs)
        options = checked_options(options, self.num_envs, self.scenario.state_size)
        chosen = options.pop("reset_mask", self._all)
        if not self._started and not chosen.all():
            raise gym.error.ResetNeeded("reset with a reset_mask before all rows were reset: reset them all first")
        rows = np.flatnonzero(chosen)
        for row in rows.tolist():
            self._starts.seed(row, seeds[row])
        self._place(rows, options)
        results = _Results.empty(self.num_envs, self.scenario.state_size)
        ended = self._ended[rows]
        self._ended[rows] = False  # before the compiled step, which would place them once more
        try:
            self._report_placed(rows, results)
        except FloatingPointError:
            self._ended[rows] = ended
            raise
        if rows.size < self.num_envs:
            others = ~chosen
            results.observations[others] = self._observed(self.states[others])
        self._started = True
        return results.observations, self._infos(results, chosen)

    def step(self, actions: Any) -> tuple[FloatArray, FloatArray, BoolArray, BoolArray, dict[str, Any]]:
        """One control period of every row.

        Args:
            actions: shape (num_envs, actuated axes), clipped to [-1, 1]; None will do for the passive task.

        Returns:
            Observations, rewards, terminations, truncations, infos.

        Raises:
            ValueError: actions of the wrong shape, or not finite, with the rows named; nothing moves then.
            ResetNeeded: never reset, or (mode DISABLED) rows that have ended, named.
            FloatingPointError: rows, named, whose motion has left the range of floating-point numbers.
        """
        if not self._started:
            raise gym.error.ResetNeeded("step called before reset: call reset first")
        numbers = self._checked_actions(actions)
        if not self._restarts_compiled():
            self._restart()

        results = _Results.empty(self.num_envs, self._state_size)
        self._advance(numbers, results)
        if self._same_step and self._ended.any():
            return self._restarted(results)
        observations, _, _, rewards, terminated, truncated = results
        return observations, rewards, terminated, truncated, self._infos(results, self._all)

    def _restarted(self, results: _Results) -> tuple[FloatArray, FloatArray, BoolArray, BoolArray, dict[str, Any]]:
        """What a step returns after which rows are placed at once."""
        last = self._ended.nonzero()[0]
        infos = self._final(results, last, self._ended.copy())
        rewards, terminated, truncated = results.rewards.copy(), results.terminated.copy(), results.truncated.copy()
        self._place(last, {})
        self._ended[last] = False
        self._report_placed(last, results)
        return results.observations, rewards, terminated, truncated, infos | self._infos(results, self._all)

    def _restarts_compiled(self) -> bool:
        """Whether the compiled step may place the rows that have ended; it has starts for all of them then."""
        if self._any_unusual or self._renderers or not self._usual_restarts:
            return False
        if not self._starts_ready:
            self._starts.prepare()
            self._starts_ready = True
        return True

    def _restart(self) -> None:
        """Places the rows that have ended."""
        restarted = self._ended.nonzero()[0]
        if restarted.size:
            if self.autoreset_mode == AutoresetMode.DISABLED:
                raise gym.error.ResetNeeded(f"rows {some(restarted)} have ended: reset them with a reset_mask first")
            self._place(restarted, {})
            self._ended[restarted] = False

    def get_state(self) -> dict[str, NDArray[Any]]:
        """All that what comes depends on, as arrays of numbers: pendulums, parameters, clocks and random numbers."""
        state = {
            "rows": self._rows.copy(),
            "started": np.array(self._started),
            "ended": self._ended.copy(),
            "unusual": self._unusual.copy(),
        }
        state |= {f"parameters.{name}": values.copy() for name, values in self._constants.items()}
        return state | {f"starts.{name}": values for name, values in self._starts.get_state().items()}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Goes on from the `get_state` of an environment with the same arguments, with the bits that it would give.

        Raises:
            ValueError: an array is missing, unknown, or of another shape or kind; nothing has changed then.
        """
        own = self.get_state()
        if state.keys() != own.keys():
            raise ValueError(f"state with {', '.join(sorted(state.keys() ^ own.keys()))} missing or unknown")
        given = {name: np.array(values) for name, values in state.items()}
        for name, values in given.items():
            if (values.shape, values.dtype) != (own[name].shape, own[name].dtype):
                raise ValueError(
                    f"state: {name} is {values.dtype} of shape {values.shape}: "
                    f"must be {own[name].dtype} of shape {own[name].shape}"
                )
        if given["started"] and not given["starts.generators"].any():
            raise ValueError(
                "state: started, but starts.generators are all zero: must be those of a random number generator"
            )
        self._starts.set_state({name: given[f"starts.{name}"] for name in self._starts.get_state()})
        self._rows[:] = given["rows"]
        self._started, self._ended[:], self._unusual = bool(given["started"]), given["ended"], given["unusual"]
        self._look_for_unusual()
        self._shown_constants = None
        for name, values in self._constants.items():
            values[:] = given[f"parameters.{name}"]
        self._starts_ready = False
        for renderer in self._renderers.values():
            renderer.forget()

    def render(self) -> tuple[Any, ...] | None:
        """A frame of each of `render_rows`, shape (height, width, 3), uint8; None without a render_mode.

        Raises:
            DependencyNotInstalled: pygame isn't there; the message says how to install it.
        """
        if self.render_mode is None:
            gym.logger.warn('render called without a render_mode: gym.make_vec(..., render_mode="rgb_array") sets one.')
            return None
        return tuple(self._frame(row) for row in self.render_rows)

    def close_extras(self, **_: Any) -> None:
        """Ends the threads and the renderers; called by `close`."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def _place(self, rows: NDArray[np.intp], options: Mapping[str, Any]) -> None:
        """Gives rows new episodes; all of them are drawn before the first is placed, so an error changes no row."""
        self._starts_ready = False
        usual = not options and not self.scenario.randomise  # this is to cost little
        if usual:
            self._starts.prepare(rows)
            batch.place(self._rows, rows, self._usual_start, self._starts.numbers, self._starts.taken)
            drawn = [self.scenario.parameters] * rows.size if self._any_unusual else []
        else:
            episodes = [
                self.scenario.draw(
                    self._starts.row(row), {name: of_row(name, value, row) for name, value in options.items()}
                )
                for row in rows.tolist()
            ]
            drawn = [parameters for parameters, _ in episodes]
            fields = [self._template_of(parameters) for parameters in drawn]
            layout.fill(self._rows, rows, np.array(fields), np.array([state for _, state in episodes]))
        if not usual or self._any_unusual:
            self._note_constants(rows, drawn)
        if self._renderers:
            for row in self._renderers.keys() & set(rows.tolist()):
                self._renderers[row].forget()

    def _note_constants(self, rows: NDArray[np.intp], drawn: Sequence[Parameters]) -> None:
        """Keeps what the infos say of the parameters of rows."""
        unusual = [parameters is not self.scenario.parameters for parameters in drawn]
        if any(unusual) or self._unusual[rows].any():
            self._unusual[rows] = unusual
            self._look_for_unusual()
            self._shown_constants = None
            for name, values in self._constants.items():
                values[rows] = [getattr(parameters, name) for parameters in drawn]

    def _look_for_unusual(self) -> None:
        """Whether all rows have the same constants, which the compiled step then reads once."""
        self._any_unusual = bool(self._unusual.any())
        self._settings[layout.ALIKE] = float(not self._any_unusual)

    def _template_of(self, parameters: Parameters) -> FloatArray:
        return self._template if parameters is self.scenario.parameters else layout.template(self.scenario, parameters)

    def _observed(self, states: FloatArray) -> FloatArray:
        """What observations show of states of shape (n, 18)."""
        return states if self.scenario.task.actuated else states[:, BODY_STATE]

    def _report_placed(self, rows: NDArray[np.intp], results: _Results) -> None:
        self._check(self._advance_rows(rows, self._no_actions, results))

    def _advance(self, actions: FloatArray, results: _Results) -> None:
        if self.threads == 1:
            status = self._advance_rows(self._shares[0], actions, results)
        else:
            each = (itertools.repeat(argument) for argument in (actions, results))
            status = max(self._threads_here().map(self._advance_rows, self._shares, *each))
        if status != layout.FINE:
            self._check(status)

    def _threads_here(self) -> concurrent.futures.ThreadPoolExecutor:
        """The threads, made when they are first needed: a copy has its own, and so has a forked process, where those of
        its parent don't run."""
        if self._pool is None or self._pool_process != os.getpid():
            self._pool = concurrent.futures.ThreadPoolExecutor(self.threads)
            self._pool_process = os.getpid()
        return self._pool

    def __getstate__(self) -> dict[str, Any]:
        """All but the threads and the renderers, which a copy makes for itself."""
        return self.__dict__ | {"_pool": None, "_renderers": {}, "_shown_constants": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        _read_only(self._all)  # which copying forgets

    def _advance_rows(self, rows: NDArray[np.intp], actions: FloatArray, results: _Results) -> int:
        """One control period of some rows; the largest STATUS."""
        if self._adaptive:
            return int(_adaptive_step()(self._rows, rows, self._ended, self._settings, actions, *results))
        status: int
        status, emptied = batch.step_batch(self._rows, rows, *self._kept, actions, *results)
        if emptied:
            self._starts_ready = False
        if status == layout.UNFINISHED:
            left = rows[self._statuses()[rows] == layout.UNFINISHED]
            _adaptive_step()(self._rows, left, self._ended, self._settings, actions, *results)
            statuses = self._statuses()[rows]
            status = int(statuses[statuses != layout.UNFINISHED].max())  # left where one of them gave up
        return status

    def _statuses(self) -> FloatArray:
        statuses: FloatArray = self._rows[:, layout.STATUS].reshape(-1)[: self.num_envs]
        return statuses

    def _check(self, status: int) -> None:
        if status != layout.FINE:
            wrong = np.flatnonzero(self._statuses() == status)
            raise FloatingPointError(f"rows {some(wrong)}: {failure(status)}")

    def _checked_actions(self, actions: Any) -> FloatArray:
        """The actions as float64, in an array that the next ones overwrite."""
        if actions is None and not self.scenario.task.actuated:
            return self._no_actions
        shape = self._actions.shape
        usual = type(actions) is np.ndarray and actions.dtype is FLOAT32 and actions.flags.c_contiguous
        try:
            numbers = actions if usual else real_numbers(actions)
        except (TypeError, ValueError, OverflowError):
            raise ValueError(f"actions = {actions!r}: must be numbers of shape {shape}") from None
        if numbers.shape != shape:
            raise ValueError(f"actions of shape {numbers.shape}: must have shape {shape}")
        if not batch.take_finite(numbers, self._actions):
            wrong = np.flatnonzero(~np.isfinite(numbers).all(axis=1))
            raise ValueError(f"actions of rows {some(wrong)}: must be finite")
        return self._actions

    def _infos(self, results: _Results, chosen: BoolArray) -> dict[str, Any]:
        """What the rows report, in Gymnasium's vector form; zero, and masked, in rows that aren't chosen."""
        if self._shown_constants is None:
            self._shown_constants = {}
            for name, values in self._constants.items():
                self._shown_constants[name] = _read_only(values.copy())
                self._shown_constants[f"_{name}"] = self._all
        outcomes, forces, constants = results.outcomes, results.forces, self._shown_constants.copy()
        if chosen is not self._all:
            outcomes = np.where(chosen, outcomes, 0.0)
            forces = np.where(chosen[:, None], forces, 0.0)
            for name, values in constants.items():
                constants[name] = chosen if name.startswith("_") else np.where(chosen, values, 0.0)
        infos: dict[str, Any] = self._told.copy()
        if chosen is not self._all:
            infos = dict.fromkeys(infos, chosen)
        infos.update(zip(self._numbers, outcomes, strict=False))  # of the passive task there are no reward terms
        infos["parameters"] = constants
        if self._actuated:
            infos["force"] = forces
        return infos

    def _final(self, results: _Results, last: NDArray[np.intp], ended: BoolArray) -> dict[str, Any]:
        """The last observations and infos of rows that ended in this step, before they are reset."""
        observations = np.full(self.num_envs, None, dtype=object)
        for row in last.tolist():
            observations[row] = results.observations[row].copy()
        return {
            "final_obs": observations,
            "_final_obs": ended,
            "final_info": self._infos(results, ended.copy()),
            "_final_info": ended,
        }

    def _frame(self, row: int) -> Any:
        if row not in self._renderers:
            from spring_pendulum_env.rendering import Renderer

            fps = self.metadata["render_fps"]
            self._renderers[row] = Renderer("rgb_array", fps, self.scenario, **self._render_options)
        block, column = divmod(row, layout.WIDTH)
        fields = self._rows[block, :, column]
        state = fields[layout.STATE : layout.STATE + 18].copy()
        force = fields[layout.FORCE : layout.FORCE + 3].copy()
        parameters = Parameters(**{name: float(values[row]) for name, values in self._constants.items()})
        return self._renderers[row].draw(
            state, parameters, force, float(fields[layout.CLOCK] * self.scenario.control_period)
        )


def _adaptive_step() -> Any:
    """The compiled step by the adaptive scheme, which takes long to import and compile: only where it is needed."""
    from spring_pendulum_env.kernels import adaptive

    return adaptive.step_batch_adaptively


class _Results(NamedTuple):
    """New arrays for what a step reports, in the order of the compiled step's arguments."""

    observations: FloatArray
    outcomes: FloatArray
    forces: FloatArray
    rewards: FloatArray
    terminated: BoolArray
    truncated: BoolArray

    @classmethod
    def empty(cls, num_envs: int, state_size: int) -> _Results:
        return cls(
            np.empty((num_envs, state_size)),
            np.empty((layout.OUTCOMES, num_envs)),
            np.empty((num_envs, 3)),
            np.empty(num_envs),
            np.empty(num_envs, dtype=BOOL),
            np.empty(num_envs, dtype=BOOL),
        )


def _shares(num_envs: int, threads: int) -> list[NDArray[np.intp]]:
    """The rows of each thread: whole blocks, shared evenly."""
    blocks = -(-num_envs // layout.WIDTH)
    bounds = [min(num_envs, layout.WIDTH * (blocks * share // threads)) for share in range(threads + 1)]
    return [np.arange(low, high) for low, high in itertools.pairwise(bounds) if high > low]


def _read_only(array: Any) -> Any:
    array.flags.writeable = False
    return array
