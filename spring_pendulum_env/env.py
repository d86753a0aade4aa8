"""The environment: Gymnasium's rules around the compiled step, and nothing else."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Unpack

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from spring_pendulum_env import integrators, layout
from spring_pendulum_env.kernels import single
from spring_pendulum_env.physics import AXES, Parameters
from spring_pendulum_env.scenario import Arguments, Scenario, real_numbers
from spring_pendulum_env.tasks import task_named

FloatArray = NDArray[np.float64]


class _Info:
    """The entries of an info, as attributes: Python makes a dict of an object's attributes, whose names all objects of the
    class share, in two thirds of the time that it takes to fill one."""

    time: float
    energy: float
    excess_energy: float
    energy_error: float
    work: float
    dissipated: float
    parameters: dict[str, float]
    force: FloatArray
    reward_energy: float
    reward_posture: float
    reward_stillness: float
    reward_centring: float
    reward_effort: float


class SpringPendulumEnv(gym.Env[FloatArray, Any]):
    """
    ## Description

    Two masses hang in three dimensions on two springs in series, with gravity and air resistance: the system of
    J. Pierce, "Double Spring Pendulum". Spring 1 runs from the anchor to mass m1, spring 2 from m1 to mass m2.

    Four ids share this class:

    | id | the anchor | the task |
    |---|---|---|
    | `SpringPendulumPassive-v0` | is the origin for ever | none: the paper's dynamics, for tests and research |
    | `SpringPendulumDamping-v0` | is a body of mass m0 that a force moves | bring the masses to rest, hanging |
    | `SpringPendulumStabilisation-v0` | the same | hold one of the four vertical equilibria |
    | `SpringPendulumSwingUp-v0` | the same | swing both springs from hanging to inverted, and hold them there |

    A gantry bears the static load of the anchor, so that no force at rest is an equilibrium anywhere. SI units, z up.

    >>> import gymnasium as gym
    >>> import spring_pendulum_env
    >>> env = gym.make("SpringPendulumPassive-v0")
    >>> rest = [0, 0, -1.1962, 0, 0, -2.2943] + [0] * 6
    >>> observation, info = env.reset(options={"state": rest})
    >>> observation, reward, terminated, truncated, info = env.step(None)
    >>> bool(abs(observation - rest).max() < 1e-12)
    True

    ## Action Space

    Actuated: `Box(-1, 1, (n,), float32)`, the force on the anchor along each of the n actuated axes in units of
    `max_force`, held for one control period. Values beyond are clipped. An action given in float64 is used unrounded.
    Passive: `Box` of shape (0,); `step(None)` works too.

    ## Observation Space

    `Box(-inf, inf, float64)`: positions in m, then velocities in m/s.

    | mode | shape | order |
    |---|---|---|
    | passive | (12,) | X1 Y1 Z1 X2 Y2 Z2, then their rates |
    | actuated | (18,) | X0 Y0 Z0 X1 Y1 Z1 X2 Y2 Z2, then their rates |

    ## Rewards

    A weighted sum of terms in [0, 1] whose weights sum to 1; each weighted term stands in `info` as `reward_NAME`.
    With E the excess energy, e the error of both spring vectors, v all velocities, q0 the anchor, a the action:

    | term | formula | damping | stabilisation | swing-up |
    |---|---|---|---|---|
    | energy | 1 / (1 + abs(E) / E1) | 0.8, E1 = 1 J | - | 0.3, E1 = 10 J |
    | posture | 1 / (1 + (e / e1)^2) | - | 0.6, e1 = 0.3 m | 0.5, e1 = 0.5 m |
    | stillness | 1 / (1 + (v / 1 m/s)^2) | - | 0.15 | - |
    | centring | 1 / (1 + (q0 / 1 m)^2) | 0.15 | 0.2 | 0.15 |
    | effort | 1 - mean of a^2 | 0.05 | 0.05 | 0.05 |

    The passive reward is 0. In the swing-up E counts from inverted rest, so it is about -59 J at the start; hanging
    still is no merit there, hence no stillness.

    ## Starting State

    About the task's equilibrium (hanging, hanging for the passive and the damping task), anchor at rest at the origin;
    the swing-up starts about hanging rest, though its equilibrium is inverted.
    Passive and damping: each mass displaced by N(0, 0.4 m) with a velocity of N(0, 1 m/s) on each axis. Stabilisation
    and swing-up: N(0, 0.05 m) and N(0, 0.05 m/s). Where the passive system lacks a spring (k = 0) it has no rest, and starts about
    the unstretched lengths, hanging. `reset(options={"state": ..., "parameters": ...})` sets the start, in the
    observation's layout, and constants of this one episode.

    >>> env = gym.make("SpringPendulumDamping-v0", parameters={"m2": 2.0})
    >>> observation, info = env.reset(seed=1, options={"parameters": {"k1": 150.0}})
    >>> info["parameters"]["k1"], info["parameters"]["m2"], env.reset()[1]["parameters"]["k1"]
    (150.0, 2.0, 100.0)

    ## Episode End

    Truncated after 1,000 steps (passive) or 500. Terminated, on the actuated tasks, when the anchor is beyond
    `anchor_travel` on an axis; in stabilisation also when a mass is over 1.5 m from its place relative to the anchor.

    ## Info

    `time` (s), `energy` (J), `excess_energy` (J, above the task's equilibrium, negative below it), `energy_error` (the part of the change
    of energy that neither the force's work nor drag accounts for, relative to the energy at the start: the paper's
    equation 42, and a measure of the integration's error in every mode), `work` and `dissipated` (J since the start),
    `parameters` (those in force); actuated also `force` (N, x y z) and each `reward_NAME`, 0 for the terms
    that the task doesn't use.

    ## Arguments

    | argument | default | meaning |
    |---|---|---|
    | `parameters` | `{}` | some of m0 m1 m2 (kg) k1 k2 (N/m) L1 L2 (m) R0 R1 R2 (kg/s) g (m/s2), or a `Parameters` |
    | `control_period` | 0.02 | s, one step of the environment |
    | `tolerance` | passive 1e-13, actuated None | None: symplectic splitting of order 6 with steps of at most 0.02 s; a number: adaptive Dormand-Prince 8(5,3) at that relative and absolute tolerance |
    | `randomise` | `{}` | parameter name: (low, high), drawn anew at each reset |
    | `start_scale` | 1 | multiplies the spread of the start |
    | `render_mode` | None | "human" or "rgb_array" |
    | `render_options` | `{}` | some of size ([600, 600], pixels), azimuth (-62, degrees), elevation (14, degrees), zoom (1), trail (2, s), title ("") |
    | `max_force` | 20 | N on each axis (actuated) |
    | `anchor_travel` | 2 | m on each axis (actuated) |
    | `actuated_axes` | "xyz" | axes along which the anchor moves; along the others it is held (actuated) |
    | `equilibrium` | "inverted-inverted" | "hanging-hanging", "hanging-inverted", "inverted-hanging" or "inverted-inverted", spring 1 named first (stabilisation) |

    A wrong argument, option, state or action raises a `ValueError` that names it and says what is allowed. So do
    parameters with which one control period would take the splitting more than 62,500 steps: springs too stiff, masses
    too light, or a period too long (beyond 1,250 s with the defaults). The adaptive scheme gives up after a million
    steps in one control period, which is a `FloatingPointError`. So no step takes longer than a few seconds for each
    pendulum, and a batch stops at the first that gives up.

    ## Version History

    * v0: initial version.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 50}  # noqa: RUF012

    def __init__(
        self,
        task: str,
        render_mode: str | None = None,
        render_options: Mapping[str, Any] | None = None,
        **arguments: Unpack[Arguments],
    ) -> None:
        self.scenario = Scenario.of(task_named(task), **arguments)
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            allowed = ", ".join(map(repr, self.metadata["render_modes"]))
            raise ValueError(f"render_mode = {render_mode!r}: must be None, {allowed}")
        self.render_mode = render_mode
        self._render_options = checked_render_options(render_options)
        self.metadata = {**self.metadata, "render_fps": max(1, round(1.0 / self.scenario.control_period))}
        self.observation_space = spaces.Box(-np.inf, np.inf, (self.scenario.state_size,), np.float64)
        self.action_space = spaces.Box(-1.0, 1.0, (len(self.scenario.actuated_axes),), np.float32)

        # No more attributes than must be: an object of more than thirty has them looked up more slowly by CPython, which
        # costs a step a fortieth of its time.
        self._parameters = self.scenario.parameters
        self._constants: dict[str, float] = self._parameters.as_dict()
        self._cell = np.zeros(layout.CELL)
        self._cell[layout.CELL_SETTINGS : layout.SPREAD] = layout.settings_of(self.scenario)
        self._cell[layout.SPREAD : layout.NOISE] = self.scenario.spread
        self._template = layout.template(self.scenario, self.scenario.parameters)
        self._usual_start = self._template.copy()
        self._usual_start[layout.STATE : layout.STATE + 18] = self.scenario.start
        self._usual_start[layout.FRESH] = layout.DISPLACED
        self._no_action = np.zeros(self.action_space.shape)
        self._renderer: Any = None
        self._actuated = self.scenario.task.actuated
        self._on_screen = render_mode == "human"
        self._started = False
        self._look_into_cell()

    def _look_into_cell(self) -> None:
        """Sets the views into `_cell` through which this environment sees its pendulum."""
        self._fields = self._cell[: layout.FIELDS]
        self._noise = self._cell[layout.NOISE :]
        self._full_state = self._cell[layout.STATE : layout.STATE + 18]
        # A copy of what the observation shows: of all, or of the numbers of the two masses.
        self._observe = self._full_state.copy
        if not self.scenario.task.actuated:
            self._observe = self._full_state.reshape(2, 9)[:, 3:].flatten
        self._copy_force = self._cell[layout.FORCE : layout.FORCE + 3].copy
        self._address = float(self._cell.ctypes.data)
        # Where all axes are actuated and the action is an array, the compiled step looks at the numbers itself.
        tolist: Callable[[Any], Any] = np.ndarray.tolist
        self._numbers_of = tolist if self.scenario.actuated_axes == AXES else self._checked_action
        self._compiled_step = self._step_of_this_episode()
        self._advance = self._compiled_step if self._started else _before_reset

    def _step_of_this_episode(self) -> single.Advance:
        """By the scheme, and with drag only where there is some."""
        if self.scenario.tolerance is not None:
            return _adaptive_step()
        return single.entry(single.advance_with_drag if any(self._parameters.drag_rates()) else single.advance)

    def __getstate__(self) -> dict[str, Any]:
        """All but the window, the compiled step and the views, which would be copied apart from what they show."""
        views = (
            "_fields",
            "_noise",
            "_full_state",
            "_observe",
            "_copy_force",
            "_address",
            "_numbers_of",
            "_compiled_step",
            "_advance",
        )
        return {name: value for name, value in self.__dict__.items() if name not in views} | {"_renderer": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._look_into_cell()

    @property
    def parameters(self) -> Parameters:
        """The constants in force in this episode."""
        return self._parameters

    @property
    def state(self) -> FloatArray:
        """The state with the anchor, shape (18,), whatever the observation shows of it; a copy."""
        return self._full_state.copy()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Starts an episode.

        Args:
            seed: of the random numbers, as Gymnasium has it.
            options: "state", the start in the observation's layout; "parameters", constants for this episode.

        Returns:
            The observation, and the info.

        Raises:
            ValueError: an unknown option, or a wrong state or parameter.
            FloatingPointError: the energy at the start is beyond the range of floating-point numbers.
        """
        super().reset(seed=seed)
        parameters = self.scenario.parameters
        if options is None and not self.scenario.randomise:  # as most episodes begin, and the quickest
            self.np_random.standard_normal(out=self._noise)
            self._fields[:] = self._usual_start
        else:
            parameters, state = self.scenario.draw(self.np_random, options)
            usual = parameters is self.scenario.parameters
            self._fields[:] = self._template if usual else layout.template(self.scenario, parameters)
            self._full_state[:] = state
        if parameters is not self._parameters:
            self._parameters = parameters
            self._constants = parameters.as_dict()
            self._compiled_step = self._step_of_this_episode()
        self._started = True
        self._advance = self._compiled_step
        if self._renderer is not None:
            self._renderer.forget()
        try:
            observation, _, _, _, info = SpringPendulumEnv.step(self, self._no_action)  # which only reports a new start
        except FloatingPointError:
            self._started, self._advance = False, _before_reset
            raise
        return observation, info

    def step(self, action: Any) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """One control period under a force that is held.

        Args:
            action: see the class; shape (number of actuated axes,), clipped to [-1, 1].

        Returns:
            The observation, the reward, whether the task's condition to end is met, False (the time limit is a
            wrapper's), and the info.

        Raises:
            ValueError: an action of the wrong shape or not finite; the state stays as it was.
            ResetNeeded: the environment was never reset.
            FloatingPointError: the motion has left the range of floating-point numbers, or the adaptive scheme would
                need more than a million steps for this control period.
        """
        # Python 3.11 is slow to call an attribute that isn't a method: these four are a twentieth of a step.
        numbers_of = self._numbers_of
        advance = self._advance
        observe = self._observe
        copy_force = self._copy_force
        try:
            x, y, z = numbers_of(action)
            if type(x) is not float:  # bytes, dates and the like, of which some would pass for integers
                raise TypeError
            told = advance(self._address, x, +y, +z)  # text, of which it would read a number, has no plus
        except (TypeError, ValueError, OverflowError):
            told = advance(self._address, *self._checked_action(action))
        if told[0]:  # not layout.FINE, which would take time to look up
            told = self._second_try(told, action)
        if self._on_screen:
            self.render()
        info = _Info()
        (
            _,
            info.time,
            info.energy,
            info.excess_energy,
            info.energy_error,
            info.work,
            info.dissipated,
            reward,
            ended,
            energy,
            posture,
            stillness,
            centring,
            effort,
        ) = told
        info.parameters = self._constants.copy()
        if self._actuated:
            info.force = copy_force()
            info.reward_energy = energy
            info.reward_posture = posture
            info.reward_stillness = stillness
            info.reward_centring = centring
            info.reward_effort = effort
        return observe(), reward, ended, False, info.__dict__

    def render(self) -> Any:
        """A frame, shape (height, width, 3), uint8, in mode "rgb_array"; shows one on the screen in mode "human".

        Raises:
            ResetNeeded: the environment was never reset.
            DependencyNotInstalled: pygame isn't there; the message says how to install it.
        """
        if not self._started:
            raise gym.error.ResetNeeded("render called before reset: call reset first")
        if self.render_mode is None:
            gym.logger.warn('render called without a render_mode: gym.make(..., render_mode="rgb_array") sets one.')
            return None
        if self._renderer is None:
            from spring_pendulum_env.rendering import Renderer

            fps = self.metadata["render_fps"]
            self._renderer = Renderer(self.render_mode, fps, self.scenario, **self._render_options)
        return self._renderer.draw(
            self._full_state, self._parameters, self._copy_force(), float(self._cell[layout.TIME])
        )

    def close(self) -> None:
        """Closes the window, if there is one. May be called twice."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _checked_action(self, action: Any) -> tuple[float, float, float]:
        """The action along x, y and z, if its shape and type are right."""
        if action is None and not self.scenario.task.actuated:
            return 0.0, 0.0, 0.0
        try:
            numbers = real_numbers(action)
        except (TypeError, ValueError, OverflowError):
            raise ValueError(f"action = {action!r}: must be {len(self.scenario.actuated_axes)} numbers") from None
        if numbers.shape != self.action_space.shape:
            raise ValueError(f"action of shape {numbers.shape}: must have shape {self.action_space.shape}")
        x, y, z = (numbers.item(place) if place >= 0 else 0.0 for place in map(self.scenario.actuated_axes.find, AXES))
        return x, y, z

    def _second_try(self, told: single.Told, action: Any) -> single.Told:
        """What a step that wasn't FINE tells in the end: by the adaptive scheme, if the splitting left it to that."""
        if told[0] == layout.UNFINISHED:
            told = _adaptive_step()(self._address, *self._checked_action(action))
        if told[0] != layout.FINE:
            self._refuse(told[0], action)
        return told

    def _refuse(self, status: int, action: Any) -> None:
        if status == layout.BAD_ACTION:
            raise ValueError(f"action = {action!r}: must be finite")
        raise FloatingPointError(f"{failure(status)} (state {self._full_state}, {self._parameters})")


def _before_reset(_address: float, _x: float, _y: float, _z: float) -> single.Told:
    """Stands for the compiled step until the first reset."""
    raise gym.error.ResetNeeded("step called before reset: call reset first")


def _adaptive_step() -> single.Advance:
    """The compiled step by the adaptive scheme, which takes long to import and compile: only where it is needed."""
    from spring_pendulum_env.kernels import adaptive

    return single.entry(adaptive.advance_adaptively)


RENDER_OPTIONS = ("size", "azimuth", "elevation", "zoom", "trail", "title")
"""The arguments of `Renderer` that `render_options` may hold."""


def checked_render_options(value: Any) -> dict[str, Any]:
    """`render_options` with known names; their values are checked by the renderer, when there is one.

    Raises:
        ValueError: it is no mapping, or holds an unknown name.
    """
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise ValueError(f"render_options = {value!r}: must be a mapping of {', '.join(RENDER_OPTIONS)}")
    for name in value:
        if name not in RENDER_OPTIONS:
            raise ValueError(f"render_options: unknown name {name!r}: must be one of {', '.join(RENDER_OPTIONS)}")
    return dict(value)


def failure(status: int) -> str:
    """What a STATUS of the compiled step other than FINE and BAD_ACTION means."""
    if status == layout.TOO_MANY_STEPS:
        return f"the motion needs more than {integrators.MOST_STEPS} steps of the adaptive scheme in one control period"
    return "the motion has left the range of floating-point numbers"
