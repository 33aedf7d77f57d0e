"""Small networks in ONNX, made by code."""

import numpy as np
import pytest

onnx = pytest.importorskip("onnx", reason="needs the extra onnx")
pytest.importorskip("onnxruntime", reason="needs the extra onnx")


def save(path, nodes, inputs, outputs, constants, kind=onnx.TensorProto.FLOAT):
    """Write a graph; inputs: name -> shape; outputs: names; constants: name -> array."""
    given = [onnx.helper.make_tensor_value_info(name, kind, shape) for name, shape in inputs.items()]
    told = [onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, None) for name in outputs]
    held = [onnx.numpy_helper.from_array(np.asarray(v), name) for name, v in constants.items()]
    made = [onnx.helper.make_node(*node[:3], **(node[3] if len(node) > 3 else {})) for node in nodes]
    graph = onnx.helper.make_graph(made, "net", given, told, held)
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=9)
    onnx.save(model, path)
    return path


def linear(path, shape, weights, bias, name="x"):
    """y = weights x + bias over all numbers of an input."""
    nodes = [("Flatten", [name], ["row"], {"axis": 0}), ("Gemm", ["row", "w", "b"], ["y"])]
    held = {"w": np.asarray(weights, np.float32).T, "b": np.asarray(bias, np.float32)}
    return save(path, nodes, {name: shape}, ["y"], held)
