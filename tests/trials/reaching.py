"""A policy in ONNX that is told no force: it goes to the goal, and down."""

from pathlib import Path

import numpy as np
import pytest

from vispeg.interface.interface import KEY, Interface
from vispeg.interface.terms import FELT
from vispeg.task.environments.vector import world_of
from vispeg.task.interface import interface_in

DOWN = 0.3  # of an action's offset


def meaning(mode: str = "state", told: tuple[str, ...] = FELT, **settings) -> Interface:
    """What it is told in the nominal world: all that policies are told but the terms `told`."""
    _, config, file = world_of("nominal", settings)
    whole = interface_in(config, file, mode, modality=mode, world="nominal")
    return whole.model_copy(update={"told": tuple(t for t in whole.told if t.name not in told)})


def reaching(path: Path, interface: Interface) -> Path:
    """Write the policy: `clip(-tip / offset)` to the side, and a share of the offset downwards."""
    onnx = pytest.importorskip("onnx")
    from onnx import TensorProto, helper, numpy_helper

    width, n = interface.stack * sum(t.size for t in interface.told), len(interface.dof)
    weight = np.zeros((width, n), np.float32)
    weight[[0, 1], [0, 1]] = -interface.terms[0].scale / interface.offset_m
    values = {"w": weight, "b": np.array([0, 0, -DOWN][:n], np.float32), "low": np.float32(-1), "high": np.float32(1)}
    inputs = [helper.make_tensor_value_info("policy", TensorProto.FLOAT, ["n", width])]
    nodes = [helper.make_node("Gemm", ["policy", "w", "b"], ["asked"])]
    for key, seen in interface.images.items():  # looked at, and of no weight
        kind = TensorProto.UINT8 if key.startswith("rgb") else TensorProto.FLOAT
        inputs.append(helper.make_tensor_value_info(key, kind, ["n", *seen.shape]))
        values["nothing"] = np.float32(0)
        nodes += [
            helper.make_node("Cast", [key], [f"{key}_f"], to=TensorProto.FLOAT),
            helper.make_node("ReduceMean", [f"{key}_f"], [f"{key}_m"], axes=[1, 2, 3], keepdims=0),
            helper.make_node("Mul", [f"{key}_m", "nothing"], [f"{key}_0"]),
            helper.make_node("Add", ["asked" if len(nodes) == 1 else f"asked_{len(nodes)}", f"{key}_0"], [""]),
        ]
        nodes[-1].output[0] = f"asked_{len(nodes)}"
    nodes.append(helper.make_node("Clip", [nodes[-1].output[0], "low", "high"], ["action"]))
    out = helper.make_tensor_value_info("action", TensorProto.FLOAT, ["n", n])
    kept = [numpy_helper.from_array(np.asarray(v), name) for name, v in values.items()]
    model = helper.make_model(
        helper.make_graph(nodes, "reaching", inputs, [out], kept), opset_imports=[helper.make_opsetid("", 17)]
    )
    model.ir_version = 8
    helper.set_model_props(model, {KEY: interface.text()})
    onnx.save(model, str(path))
    return path
