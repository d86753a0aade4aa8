"""The protocol: measures of known episodes, statistics against SciPy's, entries, and scores that are kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.stats

import spring_pendulum_env
from agents.baselines import Damper, Nothing
from agents.disturbances import Disturbance
from agents.entries import CLASSICAL, find, is_for, score_entry
from agents.evaluation import FIRST_SEED, STARTS, TRIALS, TUNING_SEED, evaluate, score, stabilisation, table
from agents.lqr import LQR
from agents.measures import Episodes, damping_values, settling_times, stabilisation_values
from agents.rollout import roll_out
from agents.statistics import bootstrap, estimate, interquartile_mean, median, paired_difference, wilson
from agents.tuned import read_settings, tuned_lqr
from spring_pendulum_env import Parameters

DAMPING = "SpringPendulumDamping-v0"
STABILISATION = "SpringPendulumStabilisation-v0"


# Measures


def hand_made(ratios: list[list[float]], ended_early: list[bool]) -> Episodes:
    """Episodes of 4 control periods of 0.5 s, 10 J at the start, that stay at rest; a short list ended early."""
    n, steps = len(ratios), 4
    rest = spring_pendulum_env.equilibrium(Parameters(), "hanging-hanging")
    excess = np.full((n, steps + 1), np.nan)
    states = np.full((n, steps + 1, 18), np.nan)
    forces = np.full((n, steps, 3), np.nan)
    rewards = np.full((n, steps), np.nan)
    for i, row in enumerate(ratios):
        excess[i, : len(row)] = 10 * np.array(row)
        states[i, : len(row)] = rest
        forces[i, : len(row) - 1] = [1.0, 2.0, 2.0]
        rewards[i, : len(row) - 1] = 0.5
    lengths = np.array([len(row) - 1 for row in ratios])
    times = 0.5 * np.arange(steps + 1)
    return Episodes(times, states, excess, forces, rewards, np.tile(rest, (n, 1)), lengths, np.array(ended_early))


def test_damping_measures_of_known_episodes() -> None:
    episodes = hand_made(
        [
            [1.0, 0.5, 0.005, 0.005, 0.005],  # settles at 1 s
            [1.0, 0.005, 0.5, 0.005, 0.005],  # seems to at 0.5 s, does so at 1.5 s
            [1.0, 0.5, 0.5, 0.5, 0.01],  # 1 % is not under 1 %
            [1.0, 0.005, 0.005],  # calm, but ended early
        ],
        [False, False, False, True],
    )
    values = damping_values(episodes)
    assert values["settled"].tolist() == [1, 1, 0, 0]
    assert values["settling_time"].tolist() == [1.0, 1.5, np.inf, np.inf]
    assert values["energy_integral"] == pytest.approx([0.50625, 0.50625, 1.0025, 0.25125 + 0.0025 + 0.005])
    assert values["effort"] == pytest.approx([18.0, 18.0, 18.0, 9.0])
    assert values["anchor_travel"].tolist() == [0, 0, 0, 0]
    assert values["mean_reward"].tolist() == [0.5, 0.5, 0.5, 0.25]
    with pytest.raises(ValueError, match="excess energy of 0"):
        damping_values(hand_made([[0.0, 0.0, 0.0, 0.0, 0.0]], [False]))


def test_stabilisation_measures_of_known_episodes() -> None:
    episodes = hand_made([[1.0] * 5] * 6 + [[1.0] * 4], [False] * 6 + [True])
    states = episodes.states
    states[1, :3, 6] += 0.11  # mass 2 out of place until 1 s: back for the last half second only
    states[2, :2, 4] += 0.11  # mass 1 out of place until 0.5 s: back for the last second
    states[3, 4, 3:5] += 0.08  # 0.08 m on each of two axes is more than 0.1 m
    states[4, :, [0, 3, 6]] -= 0.6  # all in place, but the anchor 0.6 m away
    states[5, :, [1, 4, 7]] += 0.4  # 0.4 m away is near enough
    values = stabilisation_values(episodes)
    assert values["recovered"].tolist() == [1, 0, 1, 0, 0, 1, 0]
    assert values["recovery_time"].tolist() == [0.0, np.inf, 1.0, np.inf, np.inf, 0.0, np.inf]
    assert values["anchor_travel"] == pytest.approx([0, 0, 0, 0, 0.6, 0.4, 0])


def test_settling_times() -> None:
    calm = np.array([[1, 1, 1], [0, 0, 1], [1, 1, 0], [0, 1, 1], [0, 1, 1]], dtype=bool)
    ended_early = np.array([0, 0, 0, 0, 1], dtype=bool)
    assert settling_times(calm, np.array([0.0, 0.1, 0.2]), ended_early).tolist() == [0.0, 0.2, np.inf, 0.1, np.inf]


def test_intervals_cover_what_they_should() -> None:
    random = np.random.default_rng(5)
    estimates = [estimate(random.exponential(size=80), "amount") for _ in range(200)]
    covered = np.mean([found.low <= np.log(2) <= found.high for found in estimates])
    assert 0.9 < covered < 0.99
    censored = estimate(np.array([1.0] * 60 + [np.inf] * 40), "amount")
    assert censored.value == censored.low == 1.0


def test_every_controller_gets_the_same_unseen_starts() -> None:
    one, two = (roll_out(Nothing(), DAMPING, {}, range(FIRST_SEED, FIRST_SEED + 3)) for _ in range(2))
    assert np.array_equal(one.states, two.states, equal_nan=True)
    assert len(np.unique(one.states[:, 0, 3])) == 3
    assert not np.nan_to_num(one.forces).any()


def test_an_early_end_is_recorded() -> None:
    class FullForce(Nothing):
        def actions(self, observations: np.ndarray, deterministic: bool) -> np.ndarray:
            return super().actions(observations, deterministic) + np.array([1.0, 0.0, 0.0])

    (evaluation,) = evaluate({"full force": FullForce()}, DAMPING, {}, 3)
    episodes = evaluation.episodes
    assert episodes.ended_early.all()
    assert (episodes.lengths < 100).all()
    for i, length in enumerate(episodes.lengths):
        assert np.abs(episodes.states[i, length, :3]).max() > 2.0
        assert np.isnan(episodes.states[i, length + 1 :]).all()
        assert evaluation.values["effort"][i] == pytest.approx(400.0 * 0.02 * length)
    assert not evaluation.values["settled"].any()


def test_evaluation_refuses_what_it_cannot_score() -> None:
    with pytest.raises(ValueError, match="episodes is 0"):
        evaluate({"nothing": Nothing()}, DAMPING, {}, 0)
    with pytest.raises(ValueError, match=r"SpringPendulumPassive-v0.*allowed are"):
        evaluate({"nothing": Nothing()}, "SpringPendulumPassive-v0", {}, 3)
    assert table([], DAMPING).count("\n") == 1


def test_a_row_plays_as_a_single_environment_does() -> None:
    import gymnasium as gym

    lqr = LQR(Parameters(), "inverted-inverted")
    episodes = roll_out(lqr, STABILISATION, {}, [FIRST_SEED + i for i in range(6)])
    assert 0 < episodes.ended_early.sum() < 6
    for i in range(6):
        env = gym.make(STABILISATION)
        observation, _ = env.reset(seed=FIRST_SEED + i)
        for step in range(episodes.lengths[i]):
            assert observation == pytest.approx(episodes.states[i, step], abs=1e-6)
            observation, reward, terminated, truncated, info = env.step(lqr.predict(observation)[0])
            assert reward == pytest.approx(episodes.rewards[i, step], abs=1e-6)
        assert terminated == episodes.ended_early[i]
        assert truncated != episodes.ended_early[i]
        assert info["excess_energy"] == pytest.approx(episodes.excess_energy[i, episodes.lengths[i]], abs=1e-4)


# Disturbances


def test_parameters_of_each_row_are_in_force() -> None:
    masses = np.array([0.7, 1.0, 1.3])
    rows = roll_out(Nothing(), DAMPING, {}, range(3), Disturbance(parameters={"m2": masses}))
    for row, mass in zip(rows.equilibria, masses, strict=True):
        assert np.array_equal(row, spring_pendulum_env.equilibrium({"m2": mass}, "hanging-hanging"))


def test_noise_is_seen_by_the_controller_alone() -> None:
    seen = []

    class Watching(Nothing):
        def actions(self, observations: np.ndarray, deterministic: bool) -> np.ndarray:
            seen.append(observations.copy())
            return super().actions(observations, deterministic)

    quiet = roll_out(Nothing(), DAMPING, {}, range(40))
    noisy = roll_out(Watching(), DAMPING, {}, range(40), Disturbance(noise=0.1))
    assert np.array_equal(quiet.states, noisy.states, equal_nan=True)
    added = (np.array(seen[:20]) - noisy.states[:, :20].swapaxes(0, 1)).ravel()
    assert added.std() == pytest.approx(0.1, rel=0.05)
    assert abs(added.mean()) < 0.005


def test_a_delay_holds_actions_back() -> None:
    class Counting(Nothing):
        count = 0

        def actions(self, observations: np.ndarray, deterministic: bool) -> np.ndarray:
            self.count += 1
            return super().actions(observations, deterministic) + 1e-3 * self.count

    forces = roll_out(Counting(), DAMPING, {}, [0], Disturbance(delay=3)).forces[0, :8, 0]
    assert forces == pytest.approx(0.02 * np.array([0, 0, 0, 1, 2, 3, 4, 5]))


def test_a_kick_is_an_impulse_on_each_mass() -> None:
    arguments = {"equilibrium": "hanging-hanging", "start_scale": 0.0}
    disturbance = Disturbance(kick=0.5, kick_time=0.1, parameters={"m1": np.array([1.0, 2.0])})
    states = roll_out(Nothing(), STABILISATION, arguments, [0, 1], disturbance).states
    assert states[:, 5, 12:18] == pytest.approx(0.0, abs=1e-12)
    after = states[:, 6, 12:18].reshape(2, 2, 3)
    speeds = np.linalg.norm(after, axis=2)
    assert speeds == pytest.approx(np.array([[0.5, 0.5], [0.25, 0.5]]), rel=0.05)  # the springs pull for 0.02 s
    assert states[:, 6, 3:9] - states[:, 5, 3:9] == pytest.approx(0.02 * after.reshape(2, 6), abs=2e-3)
    with pytest.raises(ValueError, match=r"delay is -1; allowed"):
        Disturbance(delay=-1)


# Statistics


def test_bootstrap_agrees_with_scipy() -> None:
    values = np.random.default_rng(3).exponential(size=300)
    for name, statistic in (("median", np.median), ("interquartile mean", _trimmed)):
        ours = bootstrap([values], name, resamples=4000)
        theirs = scipy.stats.bootstrap(
            (values,), statistic, n_resamples=4000, method="percentile", rng=np.random.default_rng(4)
        ).confidence_interval
        width = theirs.high - theirs.low
        assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=0.1 * width)
        assert ours.low < ours.value < ours.high


def _trimmed(values: np.ndarray, axis: int) -> np.ndarray:
    return np.asarray(scipy.stats.trim_mean(values, 0.25, axis=axis))


def test_strata_are_drawn_apart() -> None:
    """Two tasks of which each is sure: drawn together, their numbers would vary; drawn apart, they cannot."""
    assert bootstrap([np.zeros(50), np.ones(50)], "mean").low == 0.5
    assert bootstrap([np.r_[np.zeros(50), np.ones(50)]], "mean").low < 0.45


def test_trainings_that_differ_widen_the_interval() -> None:
    same = np.random.default_rng(0).normal(size=(1, 400))
    alike, apart = np.repeat(same, 4, axis=0), np.repeat(same, 4, axis=0) + np.array([[-1.0], [-0.3], [0.3], [1.0]])
    one, four, spread = (bootstrap([array], "mean") for array in (same, alike, apart))
    assert four.high - four.low == pytest.approx(one.high - one.low, rel=0.15)
    assert spread.high - spread.low > 3 * (one.high - one.low)


def test_statistics_of_known_numbers() -> None:
    assert median(np.array([3.0, 1.0, np.inf, np.inf])) == np.inf
    assert median(np.array([3.0, 1.0, 2.0, np.inf])) == 2.5
    assert interquartile_mean(np.array([100.0, 1.0, 2.0, -50.0])) == 1.5
    assert interquartile_mean(np.array([1.0, 2.0, 3.0, np.inf])) == 2.5
    ones = np.r_[np.ones(8), np.zeros(2)]
    assert (wilson(ones).value, wilson(ones).low, wilson(ones).high) == pytest.approx((0.8, 0.4901625, 0.9433178))
    reference = scipy.stats.binomtest(8, 10).proportion_ci(method="wilson")
    assert (wilson(ones).low, wilson(ones).high) == pytest.approx((reference.low, reference.high))
    with pytest.raises(ValueError, match=r"statistic is 'mode'; allowed are mean, median"):
        bootstrap([ones], "mode")
    with pytest.raises(ValueError, match="strata"):
        bootstrap([], "mean")


def test_paired_differences_see_what_unpaired_intervals_hide() -> None:
    random = np.random.default_rng(1)
    hard = random.exponential(size=400)
    first, second = hard + 0.1, hard + 0.02 * random.normal(size=400)
    found = paired_difference(first, second)
    assert found.low > 0.09
    assert found.high < 0.11
    assert estimate(second, "amount").high > estimate(first, "amount").low
    lost = paired_difference([np.inf, np.inf, 1.0], [np.inf, 2.0, np.inf])
    assert lost.value == 0.0
    with pytest.raises(ValueError, match="3 and 2 starts"):
        paired_difference(np.ones(3), np.ones(2))


# Trials, entries and scores


def test_trials_have_their_spread() -> None:
    for trial in TRIALS.values():
        starts = roll_out(Nothing(), trial.environment_id, trial.arguments, range(60)).states[:, 0]
        rest = spring_pendulum_env.equilibrium({}, trial.equilibrium)
        assert (starts - rest)[:, 3:9].std() == pytest.approx(trial.spread, rel=0.15)
    assert FIRST_SEED + STARTS < TUNING_SEED


def test_the_damper_only_takes_energy_out() -> None:
    """Apart from what its centring spring holds, the energy never rises."""
    damper = Damper(8.0, 2.0)
    episodes = roll_out(damper, DAMPING, {}, range(8))
    anchor = episodes.states[:, :, :3]
    total = episodes.excess_energy + 0.5 * damper.centring * (anchor**2).sum(axis=2)
    begins, ends = total[:, 0], np.array([row[length] for row, length in zip(total, episodes.lengths, strict=True)])
    assert (ends < 0.5 * begins).all()
    held = ~(np.abs(episodes.forces) >= 20.0).any(axis=2)  # within the limit the law holds, but for the 0.02 s of hold
    rises = (total[:, 1:] - total[:, :-1])[held & np.isfinite(episodes.forces[:, :, 0])]
    assert rises.max() < 2e-3 * begins.max()
    with pytest.raises(ValueError, match=r"brake is 0; allowed"):
        Damper(0, 1.0)


def test_tuned_settings_beat_the_rest() -> None:
    """On a few unseen starts where the difference is large."""
    trial = TRIALS["inverted-inverted-0.05"]
    shares = {name: score_without_saving(name, trial.name) for name in ("lqr", "lqr-tuned")}
    assert shares["lqr-tuned"] > shares["lqr"] + 0.1
    assert score_without_saving("damper", "damping") > 0.9
    assert score_without_saving("drag", "damping") > score_without_saving("nothing", "damping")
    assert set(read_settings()) == set(TRIALS)
    with pytest.raises(ValueError, match=r"'inverted-inverted-9', for which no lqr was tuned; allowed are damping"):
        tuned_lqr("inverted-inverted-9", None)  # type: ignore[arg-type]


def score_without_saving(name: str, trial_name: str, starts: int = 150) -> float:
    trial = TRIALS[trial_name]
    entry = find(name)
    (controller,) = entry.controllers(trial)
    (evaluation,) = evaluate({name: controller}, trial.environment_id, entry.arguments(trial), starts)
    measures = evaluation.values
    return float(measures["settled" if "settled" in measures else "recovered"].mean())


def test_scores_are_kept_and_measured_anew_where_something_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from agents import evaluation

    played = []
    rolling = evaluation.roll_out
    monkeypatch.setattr(evaluation, "roll_out", lambda *a: (played.append(1), rolling(*a))[1])
    lqr, other = LQR({}, "hanging-inverted"), LQR({}, "hanging-inverted", effort_weight=1.0)
    arguments = stabilisation("hanging-inverted", 0.1).arguments
    first = score(lqr, STABILISATION, arguments, tmp_path / "a.npz", starts=4)
    again = score(lqr, STABILISATION, arguments, tmp_path / "a.npz", starts=4)
    assert len(played) == 1
    assert all(np.array_equal(first[name], again[name]) for name in first)
    assert first["recovered"].shape == (4,)
    assert 0 < first["action_time"][0] < 1
    score(other, STABILISATION, arguments, tmp_path / "a.npz", starts=4)
    score(other, STABILISATION, arguments, tmp_path / "a.npz", starts=5)
    score(other, STABILISATION, arguments | {"max_force": 19.0}, tmp_path / "a.npz", starts=5)
    assert len(played) == 4


def test_entries_are_for_their_trials(tmp_path: Path) -> None:
    from agents.config import read_config

    config = read_config(Path("configs/stabilisation-ppo.yaml"), ["environment.equilibrium=hanging-inverted"])
    assert is_for(config, TRIALS["hanging-inverted-0.1"])
    assert not is_for(config, TRIALS["inverted-inverted-0.1"])
    assert not is_for(config, TRIALS["damping"])
    assert not CLASSICAL["damper"].controllers(TRIALS["hanging-inverted-0.1"])
    assert score_entry(CLASSICAL["damper"], TRIALS["hanging-inverted-0.1"], tmp_path) is None
    scores = score_entry(CLASSICAL["nothing"], TRIALS["damping"], tmp_path, starts=3)
    assert scores is not None
    assert scores["settled"].tolist() == [[0.0, 0.0, 0.0]]
    for name in ("magic", str(tmp_path / "none-*")):
        with pytest.raises(ValueError, match=r"entry is '.*'; allowed are nothing, drag, damper, lqr, lqr-tuned"):
            find(name)
