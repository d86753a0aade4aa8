"""A trained policy for where there is no torch: as arrays that agents/numpy_actor.py plays, and as ONNX.

Both are made from one description of the policy, a few arrays and words, and compute in double precision. A policy of
Stable-Baselines3 computes in single, and differs from them by that, some 1e-7.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.files import write_arrays, write_atomically
from agents.numpy_actor import ABOUT, FORMAT, said
from agents.policy import CLIP, EPSILON, LearnedPolicy
from agents.relative import TRANSFORM
from agents.residual import ResidualPolicy

Array = NDArray[np.float64]

ACTIVATIONS = {"tanh": ["Tanh"], "relu": ["Relu"], "silu": ["Sigmoid", "Mul"]}
"""ONNX's operators for the activations of a config; the second takes what came before too."""

OPSET = 13
"""ONNX's operator set, of 2020, and its file format, which anything in use reads."""
IR_VERSION = 8


def describe(policy: LearnedPolicy) -> dict[str, NDArray[Any]]:
    """The arrays of an export, as `agents.numpy_actor` explains them."""
    weights = {name: tensor.detach().numpy().astype(np.float64) for name, tensor in policy.network.state_dict().items()}
    if isinstance(policy, ResidualPolicy):
        features, gain = weights["features"], weights["gain"]
        shift, clip, squash = np.zeros(len(features)), np.inf, "clip"
        layers = _layers(weights, "body.")
        at_rest = said(layers, policy.config.network.activation, np.zeros((1, len(features))))[0]
        layers[-1] = layers[-1][0], layers[-1][1] - at_rest  # an equilibrium stays one
    else:
        spread = np.sqrt(policy.variance + EPSILON)
        features, shift, clip = TRANSFORM / spread[:, None], policy.mean / spread, CLIP
        on_policy = policy.config.algorithm == "ppo"
        body, last = ("mlp_extractor.policy_net.", "action_net") if on_policy else ("actor.latent_pi.", "actor.mu")
        layers = [*_layers(weights, body), (weights[f"{last}.weight"], weights[f"{last}.bias"])]
        gain = np.zeros((len(layers[-1][1]), len(TRANSFORM)))
        squash = "clip" if on_policy else "tanh"
    about = {"format": FORMAT, "activation": policy.config.network.activation, "squash": squash, "layers": len(layers)}
    arrays = {ABOUT: np.array(json.dumps(about)), "reference": policy.reference, "features": features, "gain": gain}
    arrays |= {"shift": shift, "clip": np.array(clip)}
    for number, (weight, bias) in enumerate(layers):
        arrays |= {f"weight.{number}": weight, f"bias.{number}": bias}
    return arrays


def _layers(weights: dict[str, Array], prefix: str) -> list[tuple[Array, Array]]:
    """Weight and bias of each linear layer of a torch Sequential."""
    names = [name for name in weights if name.startswith(prefix) and name.endswith(".weight")]
    return [(weights[name], weights[name.removesuffix("weight") + "bias"]) for name in names]  # in their order


def write_numpy(policy: LearnedPolicy, path: Path) -> None:
    """Write the .npz that `agents.numpy_actor.NumpyActor.load` reads. Raises OSError where it can't be written."""
    write_arrays(path, describe(policy))


def write_onnx(policy: LearnedPolicy, path: Path) -> None:
    """Write a model with the input `observation`, double (n, 18), raw, and the output `action`, double (n, axes).

    Raises ImportError without the package onnx, OSError where the file can't be written.
    """
    import onnx

    model = _model(describe(policy))
    onnx.checker.check_model(model, full_check=True)
    write_atomically(path, lambda file: file.write(model.SerializeToString()))


def _model(arrays: dict[str, NDArray[Any]]) -> Any:
    """The same computation as `NumpyActor.actions`, step by step."""
    from onnx import TensorProto, helper, numpy_helper

    about = json.loads(str(arrays[ABOUT]))
    nodes: list[Any] = []
    constants: dict[str, Any] = {}

    def constant(name: str, value: Any) -> str:
        constants[name] = numpy_helper.from_array(np.array(value, dtype=np.float64), name)
        return name

    def node(operator: str, *inputs: str, **attributes: Any) -> str:
        output = f"{operator.lower()}_{len(nodes)}"
        nodes.append(helper.make_node(operator, list(inputs), [output], **attributes))
        return output

    def clipped(name: str, limit: float) -> str:
        return node("Clip", name, constant(f"lower_{len(nodes)}", -limit), constant(f"upper_{len(nodes)}", limit))

    displaced = node("Sub", "observation", constant("reference", arrays["reference"]))
    features = node("MatMul", displaced, constant("features", arrays["features"].T))
    seen = node("Sub", features, constant("shift", arrays["shift"]))
    value = clipped(seen, float(arrays["clip"])) if np.isfinite(arrays["clip"]) else seen
    for number in range(about["layers"]):
        if number:
            before = value
            for operator in ACTIVATIONS[about["activation"]]:
                value = node(operator, value, *((before,) if operator == "Mul" else ()))
        value = node("MatMul", value, constant(f"weight_{number}", arrays[f"weight.{number}"].T))
        value = node("Add", value, constant(f"bias_{number}", arrays[f"bias.{number}"]))
    if about["squash"] == "tanh":
        value = node("Tanh", value)
    else:
        guided = clipped(node("MatMul", displaced, constant("gain", arrays["gain"].T)), 1.0)
        value = clipped(node("Add", guided, value), 1.0)
    nodes.append(helper.make_node("Identity", [value], ["action"]))

    axes = len(arrays["gain"])
    shapes = (("observation", len(arrays["reference"])), ("action", axes))
    given, told = (helper.make_tensor_value_info(name, TensorProto.DOUBLE, ["n", size]) for name, size in shapes)
    graph = helper.make_graph(nodes, "policy", [given], [told], list(constants.values()))
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
