"""The other environments and integrators that the benchmark compares with. A peer that isn't installed is skipped."""

from __future__ import annotations

import importlib
import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from spring_pendulum_env import Parameters, physics

FloatArray = NDArray[np.float64]

EMPTY = "an empty environment"
EMPTY_ID = "BenchmarkEmpty-v0"
NATIVE = "vector_entry_point"
NEVER = 10**9
"""Steps after which an episode ends that is to go on."""
PREPARED = 1000
"""Random actions that are drawn before the clock starts, and used again and again."""


class NotInstalledError(Exception):
    """A peer isn't there."""


@dataclass(frozen=True)
class Subject:
    """Something whose speed is measured."""

    name: str
    run: Callable[[int], float]
    """Makes so many calls; returns the seconds of them that went into resets, where they are taken apart, or 0."""
    steps: float = 1.0
    """Environment steps in a call: the number of environments of a batch."""


class EmptyEnv(gym.Env[FloatArray, Any]):
    """Does nothing: what Gymnasium's default wrappers cost."""

    observation_space = gym.spaces.Box(-np.inf, np.inf, (18,), np.float64)
    action_space = gym.spaces.Box(-1.0, 1.0, (3,), np.float32)

    def __init__(self) -> None:
        self._observation = np.zeros(18)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        return self._observation, {}

    def step(self, action: Any) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:  # noqa: ARG002
        return self._observation, 0.0, False, False, {}


def peer(name: str) -> Any:
    """The module of that name.

    Raises:
        NotInstalledError: it isn't installed, or something that it needs isn't.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        missing = error.name or name
        own = missing.split(".")[0] == name.split(".")[0]
        raise NotInstalledError(f"{name}: {'not installed' if own else f'needs {missing}'}, skipped") from None


def single(env_id: str, name: str | None = None) -> Subject:
    """Steps of gym.make(env_id) with its default wrappers and random actions; episodes that end start anew."""
    if env_id == EMPTY_ID and env_id not in gym.registry:
        gym.register(EMPTY_ID, entry_point=lambda **_: EmptyEnv(), max_episode_steps=500)
    try:
        env: Any = gym.make(env_id)
    except gym.error.DependencyNotInstalled:
        raise NotInstalledError(f"{env_id}: MuJoCo not installed, skipped") from None
    env.action_space.seed(0)
    actions = itertools.cycle([env.action_space.sample() for _ in range(PREPARED)])
    env.reset(seed=0)

    def run(calls: int) -> float:
        step = env.step
        resets = 0.0
        for _, action in zip(range(calls), actions, strict=False):
            _, _, terminated, truncated, _ = step(action)
            if terminated or truncated:
                begin = time.perf_counter()
                env.reset()
                resets += time.perf_counter() - begin
        return resets

    return Subject(name or env_id, run)


def _batch(name: str, env: Any, actions: Sequence[Any], warm_up: int) -> Subject:
    """Full steps of a vector environment; warmed up, so that its rows end and start anew at different times."""
    cycle = itertools.cycle(actions)
    env.reset(seed=0)

    def run(calls: int) -> float:
        for _, action in zip(range(calls), cycle, strict=False):
            env.step(action)
        return 0.0

    run(warm_up)
    return Subject(name, run, env.num_envs)


def gymnasium_batch(
    env_id: str, num_envs: int, name: str, warm_up: int, mode: str = NATIVE, **arguments: Any
) -> Subject:
    """A Gymnasium vector environment under random actions: the native one, or mode "sync"."""
    env = gym.make_vec(env_id, num_envs=num_envs, vectorization_mode=mode, **arguments)
    env.action_space.seed(0)
    return _batch(name, env, [env.action_space.sample() for _ in range(16)], warm_up)


def envpool_batch(env_id: str, num_envs: int) -> Subject:
    """EnvPool on one thread."""
    env = peer("envpool").make(env_id, env_type="gymnasium", num_envs=num_envs, num_threads=1, seed=0)
    random = np.random.default_rng(0)
    if isinstance(env.action_space, gym.spaces.Discrete):
        actions: list[Any] = [random.integers(0, env.action_space.n, num_envs).astype(np.int32) for _ in range(16)]
    else:
        actions = [random.uniform(-2, 2, (num_envs, 1)).astype(np.float32) for _ in range(16)]
    subject = _batch(f"EnvPool {env_id}", _Seedless(env, num_envs), actions, 20)
    return Subject(subject.name, subject.run, num_envs)


@dataclass(frozen=True)
class _Seedless:
    """EnvPool's environments are seeded when they are made."""

    env: Any
    num_envs: int

    def reset(self, seed: int) -> None:  # noqa: ARG002
        self.env.reset()

    def step(self, actions: Any) -> Any:
        return self.env.step(actions)


def gymnax_batch(num_envs: int, scan: int = 0) -> Subject:
    """gymnax's Acrobot with its automatic reset: one compiled call for each step, or one for `scan` steps."""
    gymnax = peer("gymnax")
    jax = peer("jax")
    env, parameters = gymnax.make("Acrobot-v1")
    keys = jax.random.split(jax.random.key(0), num_envs)
    _, state = jax.jit(jax.vmap(env.reset, in_axes=(0, None)))(keys, parameters)
    batched = jax.vmap(env.step, in_axes=(0, 0, 0, None))

    @jax.jit  # type: ignore[untyped-decorator]
    def step(key: Any, state: Any, action: Any) -> Any:
        key, now = jax.random.split(key)
        observation, state, *rest = batched(jax.random.split(now, num_envs), state, action, parameters)
        return key, state, (observation, *rest)

    @jax.jit  # type: ignore[untyped-decorator]
    def many(key: Any, state: Any, actions: Any) -> Any:
        def body(carry: Any, action: Any) -> Any:
            key, state, output = step(*carry, action)
            return (key, state), output

        (key, state), outputs = jax.lax.scan(body, (key, state), actions)
        return key, state, outputs

    random = np.random.default_rng(0)
    shape = (scan, num_envs) if scan else (num_envs,)
    prepared = [jax.numpy.asarray(random.integers(0, 3, shape).astype(np.int32)) for _ in range(1 if scan else 16)]
    actions = itertools.cycle(prepared)
    advance = many if scan else step
    carried = [jax.random.key(1), state]

    def run(calls: int) -> float:
        key, state = carried
        for _, action in zip(range(calls), actions, strict=False):
            key, state, output = advance(key, state, action)
            jax.block_until_ready(output)
        carried[:] = key, state
        return 0.0

    run(2)
    name = f"gymnax Acrobot-v1, {scan} steps in a scan" if scan else "gymnax Acrobot-v1, one call a step"
    return Subject(name, run, num_envs * max(scan, 1))


_MUJOCO = """
<mujoco>
  <option integrator="RK4" gravity="0 0 {gravity}"><flag contact="disable" constraint="disable"/></option>
  <worldbody>{bodies}</worldbody>
  <tendon>
    <spatial stiffness="{k1}" springlength="{L1}"><site site="s0"/><site site="s1"/></spatial>
    <spatial stiffness="{k2}" springlength="{L2}"><site site="s1"/><site site="s2"/></spatial>
  </tendon>
  <actuator>{actuators}</actuator>
</mujoco>
"""
_BODY = """
    <body gravcomp="{carried}">
      <joint name="x{n}" type="slide" axis="1 0 0" damping="{drag}"/>
      <joint name="y{n}" type="slide" axis="0 1 0" damping="{drag}"/>
      <joint name="z{n}" type="slide" axis="0 0 1" damping="{drag}"/>
      <inertial pos="0 0 0" mass="{mass}" diaginertia="1 1 1"/>
      <site name="s{n}"/>
    </body>"""
_FORCE = '<general joint="{axis}0" gainprm="{force}" biastype="affine" biasprm="{load} 0 0"/>'


def mujoco_model(parameters: Parameters, substeps: int, *, actuated: bool, max_force: float = 20.0) -> Any:
    """This very system in MuJoCo: point masses on three slide joints each, springs as tendons, RK4.

    Args:
        parameters: the constants.
        substeps: integration steps in 0.02 s.
        actuated: whether the anchor is a body on which a force acts; else it is a point of the world.
        max_force: newtons of an action of 1.
    """
    p = parameters.as_dict()
    bodies = [_BODY.format(n=n, mass=p[f"m{n}"], drag=p[f"R{n}"], carried=int(n == 0)) for n in range(3)]
    bodies[:1] = bodies[:1] if actuated else ['<site name="s0"/>']
    load = physics.static_load(parameters.m1, parameters.m2, parameters.g)
    forces = [_FORCE.format(axis=axis, force=max_force, load=load if axis == "z" else 0) for axis in "xyz"]
    mujoco = peer("mujoco")
    model = mujoco.MjModel.from_xml_string(
        _MUJOCO.format(
            bodies="".join(bodies), actuators="".join(forces) if actuated else "", gravity=-parameters.g, **p
        )
    )
    model.opt.timestep = 0.02 / substeps
    return model


def mujoco_run(
    model: Any, start: FloatArray, periods: int, substeps: int, action: FloatArray | None = None
) -> FloatArray:
    """The state after so many control periods, positions and then velocities; one MjData, stepped in C."""
    mujoco = peer("mujoco")
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = np.split(start, 2)
    if action is not None:
        data.ctrl[:] = action
    for _ in range(periods):
        mujoco.mj_step(model, data, nstep=substeps)
    return np.concatenate([data.qpos, data.qvel])


def mujoco_batch(start: FloatArray, num_envs: int, substeps: int, *, actuated: bool) -> Subject:
    """Control periods of many such systems, by MuJoCo's own compiled loop over them: motion alone, no reward."""
    model = mujoco_model(Parameters(), substeps, actuated=actuated)
    mujoco, rollout = peer("mujoco"), peer("mujoco.rollout")
    data = mujoco.MjData(model)
    first = np.tile(np.concatenate([[0.0], start]), (num_envs, 1))
    random = np.random.default_rng(0)
    control = np.repeat(random.uniform(-1, 1, (num_envs, 1, model.nu)), substeps, axis=1) if actuated else None
    states = [first]

    def run(calls: int) -> float:
        for _ in range(calls):
            after, _ = rollout.rollout(model, [data], states[0], control, nstep=substeps)
            states[0] = np.ascontiguousarray(after[:, -1])
            if np.abs(states[0]).max() > 1e3:  # the anchor drifts away under its force
                states[0] = first
        return 0.0

    return Subject(f"this system in MuJoCo, RK4 at {20 / substeps:g} ms", run, num_envs)


def heyoka_system(parameters: Parameters) -> Any:
    """The passive pendulum's equations as heyoka's expressions, from the package's one statement of them."""
    heyoka = peer("heyoka")
    names = ("x1", "y1", "z1", "x2", "y2", "z2")
    q, v = heyoka.make_vars(*names), heyoka.make_vars(*(f"v{name}" for name in names))
    still = [0.0] * 3
    constants = (*still, *parameters.constants(actuated_axes=""), *parameters.drag_rates())
    slope = physics.derivatives(*still, *q, *still, *v, *constants)
    return list(zip([*q, *v], [*slope[3:9], *slope[12:18]], strict=True))


Solver = Callable[[Any], FloatArray]
"""From a setting to the states at the sampling times."""


def heyoka_solver(parameters: Parameters, start: FloatArray, times: FloatArray, lanes: int = 1) -> Solver:
    """heyoka's Taylor integrator, compiled before the clock starts; with several lanes the same motion in each."""
    heyoka = peer("heyoka")
    system = heyoka_system(parameters)
    compiled: dict[float, Any] = {}
    state = start if lanes == 1 else np.repeat(start[:, None], lanes, axis=1)
    make = heyoka.taylor_adaptive if lanes == 1 else heyoka.taylor_adaptive_batch
    grid = times if lanes == 1 else np.repeat(times[:, None], lanes, axis=1)

    def solve(tolerance: float) -> FloatArray:
        if tolerance not in compiled:
            compiled[tolerance] = make(system, state, tol=tolerance)
        integrator = compiled[tolerance]
        if lanes == 1:
            integrator.time = times[0]
        else:
            integrator.set_time(times[0])
        integrator.state[:] = state
        outcome = integrator.propagate_grid(grid)
        states = np.asarray(outcome[-1])
        return states if lanes == 1 else states[..., 0]

    return solve


def scipy_solver(parameters: Parameters, start: FloatArray, times: FloatArray, *, compiled: bool) -> Solver:
    """SciPy's DOP853 over the package's equations, as plain Python or compiled by numba."""
    from scipy.integrate import solve_ivp

    if not compiled:
        from spring_pendulum_env import simulate

        return lambda tolerance: simulate(parameters, start, times, "DOP853", tolerance, tolerance).states

    slope = compiled_slope(parameters)
    span = (times[0], times[-1])
    return lambda tolerance: (
        solve_ivp(slope, span, start, "DOP853", times, rtol=tolerance, atol=tolerance).y.T  # the transpose is a view
    )


def compiled_slope(parameters: Parameters) -> Callable[[float, FloatArray], FloatArray]:
    """The right-hand side of the passive pendulum, compiled by numba."""
    import numba

    import spring_pendulum_env.kernels  # noqa: F401 (lets numba compile the functions of physics.py)

    constants = (*parameters.constants(actuated_axes=""), *parameters.drag_rates())
    derivatives = physics.derivatives

    def slope(_time: float, y: Any) -> Any:
        (w0x, w0y, w0z, w1, w2, k1, k2, L1, L2, g, load, c0, c1, c2) = constants
        d = derivatives(
            0.0, 0.0, 0.0, y[0], y[1], y[2], y[3], y[4], y[5], 0.0, 0.0, 0.0, y[6], y[7], y[8], y[9], y[10], y[11],
            0.0, 0.0, 0.0, w0x, w0y, w0z, w1, w2, k1, k2, L1, L2, g, load, c0, c1, c2,
        )  # fmt: skip
        return np.array([d[3], d[4], d[5], d[6], d[7], d[8], d[12], d[13], d[14], d[15], d[16], d[17]])

    function: Callable[[float, FloatArray], FloatArray] = numba.njit(error_model="numpy")(slope)
    return function


def installed(makers: Sequence[Callable[[], Subject]], say: Callable[[str], None]) -> list[Subject]:
    """The subjects whose packages are installed; one line for each that isn't."""
    subjects = []
    for make in makers:
        try:
            subjects.append(make())
        except NotInstalledError as error:
            say(str(error))
    return subjects
