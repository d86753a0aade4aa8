"""This very system in MuJoCo."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.measuring import FloatArray, Subject, peer
from spring_pendulum_env import Parameters, physics

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


def mujoco_runner(model: Any, substeps: int) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """From a start and actions, shape (control periods, actuators), to the state after them, positions and then
    velocities; `substeps` integration steps for each action, stepped in C."""
    mujoco = peer("mujoco")
    data = mujoco.MjData(model)

    def run(start: FloatArray, actions: FloatArray) -> FloatArray:
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = np.split(start, 2)
        control = data.ctrl
        for action in actions:
            control[:] = action
            mujoco.mj_step(model, data, nstep=substeps)
        return np.concatenate([data.qpos, data.qvel])

    return run


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
