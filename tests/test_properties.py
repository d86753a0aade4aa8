"""The environments under fire: whatever they are given, a clear error or finite, repeatable numbers.

Hypothesis makes the arguments, states, actions and orders of calls up, the same ones each time. A deeper look, with new
ones each time: HYPOTHESIS_PROFILE=deep python -m pytest tests/test_properties.py.
"""

from __future__ import annotations

import copy
import os
import pickle
from typing import Any

import gymnasium as gym
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from spring_pendulum_env import EQUILIBRIA, Parameters, integrators, layout
from spring_pendulum_env.scenario import Arguments
from spring_pendulum_env.tasks import TASKS

COMMON: dict[str, Any] = {"deadline": None, "suppress_health_check": list(HealthCheck)}
settings.register_profile("quick", max_examples=40, derandomize=True, database=None, **COMMON)
settings.register_profile("deep", max_examples=3000, print_blob=True, **COMMON)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "quick"))

IDS = list(TASKS)
DAMPING = "SpringPendulumDamping-v0"
CLEAR = (ValueError, FloatingPointError, gym.error.Error)
"""What a user may be told."""


def log_uniform(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers from 10**low to 10**high."""
    return st.floats(low, high).map(lambda exponent: 10.0**exponent)


def parameter(name: str) -> st.SearchStrategy[float]:
    """From a thousandth to a thousand times the default (where that is zero, of 0.1), and zero where it is legal."""
    usual = getattr(Parameters(), name) or 0.1
    values = log_uniform(-3, 3).map(lambda factor: usual * factor)
    return values if name[0] == "m" else st.one_of(values, st.just(0.0))


PARAMETERS = st.fixed_dictionaries({}, optional={name: parameter(name) for name in Parameters.names()})
RANGES = st.fixed_dictionaries(
    {}, optional={name: st.tuples(parameter(name), parameter(name)).map(sorted) for name in Parameters.names()}
)


def arguments(environment_id: str) -> st.SearchStrategy[dict[str, Any]]:
    """Legal arguments of gym.make, one by one; whether they go together is for the environment to say."""
    optional: dict[str, Any] = {
        "parameters": PARAMETERS,
        "control_period": st.one_of(log_uniform(-9, 0), st.just(0.02)),
        "tolerance": st.one_of(st.none(), log_uniform(-14, -3)),
        "randomise": RANGES,
        "start_scale": st.one_of(st.just(0.0), log_uniform(-3, 3)),
    }
    if TASKS[environment_id].actuated:
        optional["max_force"] = log_uniform(-2, 5)
        optional["anchor_travel"] = log_uniform(-3, 3)
        optional["actuated_axes"] = st.sampled_from(["", "x", "zy", "xyz"])
    if TASKS[environment_id].chooses_equilibrium:
        optional["equilibrium"] = st.sampled_from(EQUILIBRIA)
    return st.fixed_dictionaries({}, optional=optional)


@st.composite
def configurations(draw: st.DrawFn) -> tuple[str, dict[str, Any]]:
    environment_id = draw(st.sampled_from(IDS))
    return environment_id, draw(arguments(environment_id))


def numbers_in(value: Any) -> list[float]:
    """All numbers that an environment told, however deep."""
    if isinstance(value, dict):
        return [number for entry in value.values() for number in numbers_in(entry)]
    if isinstance(value, (tuple, list)) or (isinstance(value, np.ndarray) and value.dtype == object):
        return [number for entry in value for number in numbers_in(entry)]
    return [] if value is None else np.asarray(value, dtype=np.float64).ravel().tolist()


def told(call: Any) -> tuple[str, Any]:
    """What a call gives: all its numbers, which must be finite, or the kind of its error, which must be a clear one."""
    try:
        result = call()
    except CLEAR as error:
        assert str(error).strip()
        return type(error).__name__, None
    found = numbers_in(result)
    assert np.isfinite(found).all(), result
    return "numbers", np.array(found).tobytes()


def story(make: Any, seed: int, actions: list[Any]) -> list[tuple[str, Any]]:
    """What an environment tells from its making to its closing; it ends with the first error."""
    outcomes: list[tuple[str, Any]] = []
    made: list[Any] = []
    outcomes.append(told(lambda: made.append(make())))
    if made:
        env = made[0]
        outcomes.append(told(lambda: env.reset(seed=seed)))
        for action in actions:
            if outcomes[-1][0] != "numbers":
                break
            outcomes.append(told(lambda action=action: env.step(action)))
        env.close()
    return outcomes


# Any legal arguments.


@given(configurations(), st.integers(0, 2**31), st.integers(0, 2**31))
def test_legal_arguments_give_finite_repeatable_numbers_alone_and_side_by_side(
    configuration: tuple[str, dict[str, Any]], seed: int, action_seed: int
) -> None:
    environment_id, kwargs = configuration
    axes = len(kwargs.get("actuated_axes", "xyz")) if TASKS[environment_id].actuated else 0
    actions = list(np.random.default_rng(action_seed).uniform(-1.2, 1.2, (4, axes)))
    single = story(lambda: gym.make(environment_id, **kwargs), seed, actions)
    assert single == story(lambda: gym.make(environment_id, **kwargs), seed, actions)
    rows = [np.array([action, action]) for action in actions]

    def make_rows() -> Any:
        return gym.make_vec(environment_id, num_envs=2, autoreset_mode="DISABLED", **kwargs)

    batch = story(make_rows, seed, rows)
    assert batch == story(make_rows, seed, rows)
    if batch[0][0] == single[0][0] == "numbers":
        env, many = gym.make(environment_id, **kwargs).unwrapped, make_rows()
        for call in ["reset", *actions]:
            outcomes = []
            for one in (env, many):
                try:
                    if isinstance(call, str):
                        outcomes.append(one.reset(seed=seed)[0])
                    else:
                        outcomes.append(one.step(call if one is env else np.array([call, call]))[0])
                except CLEAR as error:
                    outcomes.append(type(error))
            if isinstance(outcomes[0], type) or isinstance(outcomes[1], type):
                break  # row 1 has another start, and may fail on its own
            assert outcomes[0].tobytes() == outcomes[1][0].tobytes()


@given(configurations())
def test_work_of_a_step_is_bounded(configuration: tuple[str, dict[str, Any]]) -> None:
    environment_id, kwargs = configuration
    try:
        env: Any = gym.make(environment_id, **{**kwargs, "control_period": 10.0}).unwrapped
        env.reset(seed=0)
    except CLEAR:
        return
    most = integrators.MOST_FIXED_STEPS if env.scenario.tolerance is None else integrators.MOST_STEPS
    assert 1 <= env._cell[layout.STEPS] <= most


@pytest.mark.parametrize("environment_id", IDS)
@pytest.mark.parametrize(
    "changes",
    [
        {"k1": 1e300, "k2": 1e300},
        {"k1": 1e308, "k2": 1e308, "m1": 1e-3},
        {"g": 1e200},
        {"g": 1e308},
        {"L1": 1e200},
        {"L1": 1e308, "L2": 1e308},
        {"m1": 1e308, "m2": 1e308},
        {"m1": 1e-308, "m2": 1e-308},
        {"R1": 1e308, "m1": 1e-3},
        {"R0": 1e308, "m0": 1e-10},
        {"m0": 1e-308},
        {"k1": 1e-308},
    ],
    ids=str,
)
def test_absurd_parameters_give_an_error_or_finite_numbers(environment_id: str, changes: dict[str, float]) -> None:
    for tolerance in (None, 1e-6):
        kwargs: dict[str, Any] = {"parameters": changes, "tolerance": tolerance}
        action = np.zeros(3 if TASKS[environment_id].actuated else 0)
        story(lambda kwargs=kwargs: gym.make(environment_id, **kwargs), 0, [action] * 2)
        story(lambda kwargs=kwargs: gym.make_vec(environment_id, num_envs=2, **kwargs), 0, [np.array([action, action])])


# Anything for an argument.

GARBAGE = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 3),
    st.sampled_from([10**400, -(10**400), 2**63]),
    st.floats(),
    st.sampled_from([5e-324, 1e-309, 1e-200, 1e200, 1.7e308]),
    st.text(max_size=4),
    st.binary(max_size=3),
    st.complex_numbers(),
    st.lists(st.one_of(st.floats(), st.text(max_size=2)), max_size=3),
    st.dictionaries(st.one_of(st.sampled_from(Parameters.names()), st.integers()), st.floats(), max_size=2),
    st.sampled_from([np.float32(0.5), np.int8(2), np.array(0.5), np.array([0.5]), np.array([1.0, 2.0]), object, max]),
)


@given(st.sampled_from(IDS), st.sampled_from([*Arguments.__annotations__, "render_options"]), GARBAGE)
def test_anything_for_an_argument_is_used_or_refused_by_name(environment_id: str, name: str, value: Any) -> None:
    for make in (gym.make, lambda *a, **k: gym.make_vec(*a, num_envs=2, **k)):
        try:
            env: Any = make(environment_id, **{name: value})
        except (ValueError, TypeError) as error:
            said = str(error)
            assert name in said or (name == "parameters" and "parameter" in said) or "equilibrium" in said
            continue
        zeros = np.zeros(env.action_space.shape)
        if told(lambda env=env: env.reset(seed=0))[0] == "numbers":
            assert told(lambda env=env, zeros=zeros: env.step(zeros))[0] in ("numbers", "FloatingPointError")
        else:
            assert told(lambda env=env: env.reset(seed=0))[0] == "FloatingPointError"
            assert told(lambda env=env, zeros=zeros: env.step(zeros))[0] == "ResetNeeded"


@given(
    st.sampled_from(["num_envs", "max_episode_steps", "autoreset_mode", "threads", "render_rows"]),
    GARBAGE.filter(lambda value: not (isinstance(value, int) and value > 2**32)),
)
def test_anything_for_an_argument_of_many_is_used_or_refused_by_name(name: str, value: Any) -> None:
    try:
        env = gym.make_vec(DAMPING, **{"num_envs": 2, name: value})
    except (ValueError, TypeError) as error:
        assert name in str(error)
        return
    assert told(lambda: env.reset(seed=0))[0] == "numbers"
    assert told(lambda: env.step(np.zeros(env.action_space.shape)))[0] == "numbers"  # type: ignore[arg-type]
    env.close()


# Anything for an action, a state, an option, a seed.

NUMBERS = st.one_of(st.floats(), st.integers(-(2**70), 2**70), st.booleans(), st.sampled_from([0.0, 0.5, -1.0, 1e400]))
DTYPES = ["?", "b", "B", "i8", "f2", "f4", "f8", "g", "F", "D", "O", "U5", "S3", "M8[s]", "V8"]


@st.composite
def arrays(draw: st.DrawFn, size: int) -> Any:
    """Arrays, lists and things that are neither, `size` being the right number of numbers."""
    kind = draw(st.sampled_from(["array", "array", "list", "garbage"]))
    if kind == "garbage":
        return draw(GARBAGE)
    shape = draw(st.sampled_from([(size,), (size,), (size,), (size + 1,), (1, size), (size, 1), (), (2, size)]))
    count = int(np.prod(shape))
    values = draw(st.lists(NUMBERS, min_size=count, max_size=count))
    if kind == "list":
        return values
    with np.errstate(all="ignore"):
        try:
            return np.array(values, dtype=draw(st.sampled_from(DTYPES))).reshape(shape)
        except (OverflowError, ValueError, TypeError):
            return np.array(values, dtype=object).reshape(shape)


@given(st.data(), st.sampled_from(IDS), st.sampled_from(["", "xz", "xyz"]))
@pytest.mark.filterwarnings("error::numpy.exceptions.ComplexWarning")
def test_any_action_is_used_or_refused_and_changes_nothing(data: st.DataObject, environment_id: str, axes: str) -> None:
    kwargs = {"actuated_axes": axes} if TASKS[environment_id].actuated else {}
    env: Any = gym.make(environment_id, disable_env_checker=True, **kwargs)
    many: Any = gym.make_vec(environment_id, num_envs=1, **kwargs)
    action = data.draw(arrays(len(env.unwrapped.scenario.actuated_axes)))
    env.reset(seed=0)
    many.reset(seed=0)
    before = env.unwrapped.state.tobytes()
    outcomes = []
    for one, given_action in ((env, action), (many, [action])):
        try:
            observation, *_, info = one.step(given_action)
            assert np.isfinite(observation).all()
            outcomes.append(observation.tobytes())
            if "force" in info:
                assert np.abs(info["force"]).max() <= 20.0
        except ValueError as error:
            assert "action" in str(error)
            outcomes.append(None)
            assert (one.unwrapped.state if one is env else one.states).tobytes() == before
    if isinstance(action, np.ndarray):
        assert outcomes[0] == outcomes[1]
    told(lambda: env.step(np.zeros(env.action_space.shape)))


@given(st.data(), st.sampled_from(IDS))
@pytest.mark.filterwarnings("error::numpy.exceptions.ComplexWarning")
def test_any_option_is_used_or_refused_and_changes_nothing(data: st.DataObject, environment_id: str) -> None:
    env: Any = gym.make(environment_id, disable_env_checker=True)
    many: Any = gym.make_vec(environment_id, num_envs=2)
    size = env.unwrapped.scenario.state_size
    name = data.draw(st.sampled_from(["state", "parameters", "reset_mask", "other"]))
    options = {name: data.draw(arrays(size) if name == "state" else GARBAGE)}
    if data.draw(st.booleans()):
        options["parameters"] = data.draw(PARAMETERS)
    for one in (env, many):
        one.reset(seed=0)
        before = (one.unwrapped.state if one is env else one.states).tobytes()
        try:
            assert np.isfinite(numbers_in(one.reset(options=options))).all()
        except ValueError as error:
            named = [*options, "parameter", "unstretched", "equilibrium"]
            assert any(str(word) in str(error) for word in named), str(error)
            assert (one.unwrapped.state if one is env else one.states).tobytes() == before
        except FloatingPointError:
            one.reset(seed=1)
        assert told(lambda one=one: one.step(np.zeros(one.action_space.shape)))[0] in ("numbers", "FloatingPointError")


@given(st.one_of(GARBAGE, st.lists(st.integers(-2, 5), min_size=2, max_size=2)))
def test_any_seed_is_used_or_refused(seed: Any) -> None:
    env: Any = gym.make(DAMPING, disable_env_checker=True)
    many: Any = gym.make_vec(DAMPING, num_envs=2)
    many.reset(seed=0)
    twin = copy.deepcopy(many)
    try:
        first = env.reset(seed=seed)[0]
        assert seed is None or first.tobytes() == env.reset(seed=seed)[0].tobytes()
    except (ValueError, TypeError, gym.error.Error) as error:
        assert str(error)
    try:
        rows = many.reset(seed=seed)[0]
        assert seed is None or rows.tobytes() == many.reset(seed=seed)[0].tobytes()
    except (ValueError, gym.error.Error) as error:
        assert "seed" in str(error).lower()
        assert many.states.tobytes() == twin.states.tobytes()
        assert many.reset()[0].tobytes() == twin.reset()[0].tobytes()  # the random numbers go on


# Any order of calls.


class Calls(RuleBasedStateMachine):
    """A single environment and a vector environment beside a twin of each that gets the same calls on a copy."""

    @initialize(
        environment_id=st.sampled_from(IDS),
        mode=st.sampled_from(["NEXT_STEP", "SAME_STEP", "DISABLED"]),
        tolerance=st.sampled_from([None, 1e-9]),
        threads=st.sampled_from([1, 2]),
    )
    def make(self, environment_id: str, mode: str, tolerance: float | None, threads: int) -> None:
        kwargs = {"tolerance": tolerance, "max_episode_steps": 3}
        self.pairs = []
        self.mode = mode
        for _ in range(2):
            self.pairs.append(
                [
                    gym.make(environment_id, **kwargs),
                    gym.make_vec(environment_id, num_envs=70, autoreset_mode=mode, threads=threads, **kwargs),
                ]
            )
        self.started = [False, False]
        self.ended = False

    def both(self, which: int, call: Any) -> str:
        """Calls one of the kinds and its twin, which must do the same; what came."""
        outcomes = [told(lambda env=env: call(env)) for env in (self.pairs[0][which], self.pairs[1][which])]
        assert outcomes[0] == outcomes[1]
        return outcomes[0][0]

    @rule(which=st.sampled_from([0, 1]), seed=st.integers(0, 9))
    def reset(self, which: int, seed: int) -> None:
        assert self.both(which, lambda env: env.reset(seed=seed)) == "numbers"
        self.started[which] = True

    @precondition(lambda self: any(self.started))
    @rule(which=st.sampled_from([0, 1]))
    def reset_on(self, which: int) -> None:
        if self.started[which]:
            assert self.both(which, lambda env: env.reset()) == "numbers"

    @rule(which=st.sampled_from([0, 1]), height=st.floats(-3, 3))
    def reset_to_a_state(self, which: int, height: float) -> None:
        def call(env: Any) -> Any:
            state = np.zeros((env.observation_space.shape[-1],))
            state[1] = height
            return env.reset(seed=0, options={"state": state})

        assert self.both(which, call) == "numbers"
        self.started[which] = True

    @rule(which=st.sampled_from([0, 1]), size=st.floats(-2, 2))
    def step(self, which: int, size: float) -> None:
        outcome = self.both(which, lambda env: env.step(np.full(env.action_space.shape, size)))
        if not self.started[which]:
            assert outcome == "ResetNeeded"
        elif which == 0 or self.mode != "DISABLED":
            assert outcome == "numbers"
        else:
            assert outcome in ("numbers", "ResetNeeded")

    @rule(which=st.sampled_from([0, 1]), wrong=st.sampled_from([np.nan, "left", None]))
    def step_wrongly(self, which: int, wrong: Any) -> None:
        def call(env: Any) -> Any:
            return env.step(wrong if not isinstance(wrong, float) else np.full((*env.action_space.shape, 2), wrong))

        outcome = self.both(which, call)
        passive = self.pairs[0][0].spec.id == IDS[0]
        if self.started[which] and not (passive and wrong is None):
            assert outcome in ("ValueError", "ResetNeeded")

    @rule(which=st.sampled_from([0, 1]), how=st.sampled_from([copy.deepcopy, lambda e: pickle.loads(pickle.dumps(e))]))
    def replace_by_a_copy(self, which: int, how: Any) -> None:
        self.pairs[1][which] = how(self.pairs[0][which])

    @rule(which=st.sampled_from([0, 1]))
    def close(self, which: int) -> None:
        self.both(which, lambda env: env.close())

    @invariant()
    def same_states(self) -> None:
        if hasattr(self, "pairs"):
            (one, many), (twin, twins) = self.pairs
            assert one.unwrapped.state.tobytes() == twin.unwrapped.state.tobytes()
            assert many.states.tobytes() == twins.states.tobytes()


TestCalls = Calls.TestCase
