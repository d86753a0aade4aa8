"""Our config in RLlib's terms: what maps is mapped, and what RLlib can't do is refused."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.algorithms.sac import SACConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.core.rl_module.rl_module import RLModuleSpec

from agents.config import Config
from agents.rllib_env import NAME, env_settings, fixed_variance, seed_of_stretch
from agents.rllib_learners import ScalingPPOLearner
from agents.rllib_modules import CONFIG, PPOModule, SACModule
from agents.training import STEPS_A_ROW

ALGORITHMS = ("ppo", "sac")
ENDED_EARLY = "ended_early"


def refuse_what_cannot_be(config: Config, runners: int) -> None:
    """Raise ValueError for a config, or a number of runners, that RLlib can't train with."""
    if runners < 0:
        raise ValueError(f"runners is {runners}; allowed is a number from 0 (none beside this process) on")
    if config.algorithm not in ALGORITHMS:
        raise ValueError(
            f"algorithm is {config.algorithm!r}, which RLlib doesn't have; allowed are {', '.join(ALGORITHMS)} "
            "(scripts/train.py trains the others)"
        )
    fixed_variance(config)
    count = config.training.environments
    if count % max(runners, 1):
        raise ValueError(f"training.environments is {count}; allowed is a multiple of the {runners} runners")
    rollout = config.ppo.n_steps * count
    if config.algorithm == "ppo" and config.ppo.batch_size > rollout:
        raise ValueError(f"ppo.batch_size is {config.ppo.batch_size}; allowed is at most a rollout, {rollout} steps")
    if config.algorithm == "sac" and config.training.normalise_reward:
        raise ValueError("training.normalise_reward is true, which RLlib's SAC cannot do; allowed is false")


def algorithm_config(config: Config, runners: int, steps_before: int = 0) -> AlgorithmConfig:
    """RLlib's config of what remains of a training after `steps_before` environment steps."""
    rllib: AlgorithmConfig = {"ppo": _ppo, "sac": _sac}[config.algorithm](config, runners, steps_before)
    seed = seed_of_stretch(config, steps_before) % 2**31  # RLlib adds a runner's number to it
    rllib.environment(NAME, env_config=dict(env_settings(config, seed)))
    rllib.env_runners(
        num_env_runners=runners,
        num_envs_per_env_runner=config.training.environments // max(runners, 1),
        gym_env_vectorize_mode=gym.VectorizeMode.VECTOR_ENTRY_POINT,
        num_cpus_per_env_runner=1,
    )
    # A runner that is lost is started again, as often as need be; until then the others do its share.
    rllib.fault_tolerance(restart_failed_env_runners=True, max_num_env_runner_restarts=1000)
    rllib.learners(num_learners=0)  # in this process: the networks are small
    rllib.debugging(seed=seed, log_level="ERROR")
    rllib.callbacks(on_episode_end=_note_the_end)
    rllib.reporting(
        min_time_s_per_iteration=0,
        min_sample_timesteps_per_iteration=STEPS_A_ROW * config.training.environments,
    )
    return rllib


def _note_the_end(*, episode: Any, metrics_logger: Any, **_: Any) -> None:
    metrics_logger.log_value(ENDED_EARLY, float(episode.is_terminated), window=100)


def _ppo(config: Config, _: int, steps_before: int) -> AlgorithmConfig:
    own = config.ppo
    remaining = max(config.training.steps - steps_before, 1)
    first = own.final_learning_rate + (own.learning_rate - own.final_learning_rate) * remaining / config.training.steps
    rllib = PPOConfig().training(
        lr=[[0, first], [remaining, own.final_learning_rate]],
        train_batch_size_per_learner=own.n_steps * config.training.environments,
        minibatch_size=own.batch_size,
        num_epochs=own.n_epochs,
        gamma=own.gamma,
        lambda_=own.gae_lambda,
        clip_param=own.clip_range,
        entropy_coeff=own.ent_coef,
        vf_loss_coeff=own.vf_coef,
        vf_clip_param=float("inf"),
        use_kl_loss=False,
        grad_clip=own.max_grad_norm,
        grad_clip_by="global_norm",
    )
    if config.training.normalise_reward:
        rllib.learners(learner_class=ScalingPPOLearner)
    spec = RLModuleSpec(module_class=PPOModule, model_config={CONFIG: config.model_dump(mode="json")})
    return rllib.rl_module(rl_module_spec=spec)


def _sac(config: Config, runners: int, steps_before: int) -> AlgorithmConfig:
    own = config.sac
    # RLlib takes steps learnt from for each step sampled, but counts one runner more than there are (see its
    # calculate_rr_weights): for as many updates in a round as we want, the wish is put in the same way.
    sampled = config.training.environments // max(runners, 1) * (runners + 1)
    rllib = SACConfig().training(
        actor_lr=own.learning_rate,
        critic_lr=own.learning_rate,
        alpha_lr=own.learning_rate,
        train_batch_size_per_learner=own.batch_size,
        training_intensity=own.gradient_steps * own.batch_size / sampled,
        num_steps_sampled_before_learning_starts=max(own.learning_starts - steps_before, own.batch_size),
        replay_buffer_config={"type": "EpisodeReplayBuffer", "capacity": own.buffer_size},
        tau=own.tau,
        gamma=own.gamma,
        twin_q=True,
    )
    layers = {"fcnet_hiddens": list(config.network.layers), "fcnet_activation": config.network.activation}
    model = vars(DefaultModelConfig(**layers)) | {CONFIG: config.model_dump(mode="json")}
    return rllib.rl_module(rl_module_spec=RLModuleSpec(module_class=SACModule, model_config=model))
