"""Write the weights of the painter's networks, from their ONNX files, as gsedit ships them.

    python -m research.convert_painter FOLDER gsedit/paper/editors/painter

FOLDER has multistyle26.onnx, arbitrary_predict.onnx and arbitrary_transform.onnx. Weights of 8 bits
stay so, with their scales; activations are not quantised. Prints the largest difference of each
network to its file. Needs onnx and onnxruntime.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import onnx  # pyright: ignore[reportMissingImports]
import onnxruntime  # pyright: ignore[reportMissingImports]
import torch
from onnx.numpy_helper import from_array, to_array  # pyright: ignore[reportMissingImports]
from safetensors.torch import save_file
from torch import Tensor

from gsedit.paper.editors.painter.editor import load_painter
from gsedit.paper.editors.painter.network import SIDE, STAGES, load_picture_styles

QUANTISED = "arbitrary_predict", "arbitrary_transform"


def read(folder: Path, name: str) -> tuple[Any, dict[str, np.ndarray]]:
    """A model, and the values of its initialisers by name."""
    model = onnx.load(str(folder / f"{name}.onnx"))
    return model, {each.name: np.asarray(to_array(each)) for each in model.graph.initializer}


def product(values: dict[str, np.ndarray], node: Any) -> np.ndarray:
    """A constant of the graph times its scales, of its first axis."""
    value, scale, zero = (values[each] for each in node.input)
    assert not zero.any()
    return value.astype(np.float32) * scale.reshape(-1, *(1,) * (value.ndim - 1))


def dequantised(model: Any, values: dict[str, np.ndarray]) -> Any:
    """A graph in float32: constants times their scales, nothing else quantised."""
    same: dict[Any, Any] = {}
    kept = []
    for node in model.graph.node:
        if node.op_type == "DequantizeLinear" and node.input[0] in values:
            value = from_array(product(values, node), node.output[0])
            model.graph.initializer.append(value)
        elif node.op_type in ("QuantizeLinear", "DequantizeLinear"):
            same[node.output[0]] = same.get(node.input[0], node.input[0])
        else:
            node.input[:] = [same.get(each, each) for each in node.input]
            kept.append(node)
    for result in model.graph.output:
        kept.append(onnx.helper.make_node("Identity", [same[result.name]], [result.name]))
    del model.graph.node[:]
    model.graph.node.extend(kept)
    return model


def convolutions(model: Any, values: dict[str, np.ndarray]) -> Iterator[tuple[str, dict]]:
    """The name of each convolution in order, and its parts as gsedit keeps them."""
    sources = {node.output[0]: node for node in model.graph.node}
    for node in model.graph.node:
        if node.op_type == "Conv":
            weight, bias = (sources[each] for each in node.input[1:])
            kernel = values[weight.input[0]]
            kernel = kernel[..., 0, 0] if kernel.shape[1] in (100, 1280) else kernel
            parts = {"weight": kernel, "scale": values[weight.input[1]]}
            parts["bias"] = product(values, bias)
            yield weight.input[0].removesuffix("/weights"), parts


def of_styles(folder: Path) -> dict[str, np.ndarray]:
    """Weights of the network of 26 styles by gsedit's names."""
    _, values = read(folder, "multistyle26")
    found = {}
    for k, name in enumerate(each[:-2] for each in values if each.endswith(".w")):
        found[f"{name.replace('res.', 'residual.')}.weight"] = values[f"{name}.w"]
        for part in ("gamma", "beta"):
            found[f"layer{k:02}.{part}"] = values[f"{name}.norm.{part}"]
    return found


def of_pictures(folder: Path) -> dict[str, np.ndarray]:
    """Weights of the networks for the style of any picture, by gsedit's names."""
    blocks = range(sum(count for _, count, _ in STAGES))
    inner = [f"blocks.{k}.{part}" for k in blocks for part in ("expand", "depthwise", "project")]
    names = ["first", *inner[1:], "last", "vector"]
    predict, transform = (list(convolutions(*read(folder, each))) for each in QUANTISED)
    layers = {f"predict.{k}": parts for k, (_, parts) in zip(names, predict, strict=True)}
    held = dict(transform)
    for k in range(3):
        layers[f"paint.contract.{k}"] = held[f"transformer/contract/conv{k + 1}"]
    pairs = [(k, i) for k in range(5) for i in range(2)]
    styled = {
        f"residual.{k}.{i}": f"transformer/residual/residual{k + 1}/conv{i + 1}" for k, i in pairs
    } | {f"expand.{k}": f"transformer/expand/conv{k + 1}/conv" for k in range(3)}
    for own, name in styled.items():
        assert not held[name].pop("bias").any()
        layers[f"paint.{own}"] = held[name]
    for own, theirs in (("gamma", "Conv_1"), ("beta", "Conv")):
        maps = [held[f"style_params/{name}/StyleNorm/{theirs}"] for name in styled.values()]
        layers[f"predict.{own}"] = {k: np.concatenate([each[k] for each in maps]) for k in maps[0]}
    return {
        f"{name}.{key}": value for name, parts in layers.items() for key, value in parts.items()
    }


def running(model: Any) -> Callable[..., np.ndarray]:
    """A graph as a function of its inputs, to its first output."""
    onnxruntime.set_default_logger_severity(3)
    session = onnxruntime.InferenceSession(model.SerializeToString())
    names = [each.name for each in session.get_inputs()]
    return lambda *given: np.asarray(session.run(None, dict(zip(names, given)))[0])


def picture(height: int, width: int, phase: int) -> Tensor:
    """A picture of waves and edges for comparisons, h w 3, that needs no random numbers."""
    rows, columns = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    waves = [torch.sin(phase + rows / (7 + k) + columns / (11 - 2 * k)) for k in range(3)]
    return torch.stack(waves, -1) * 0.3 + 0.4 + 0.25 * ((rows // 32 + columns // 48) % 2)[..., None]


@torch.no_grad()
def differences(folder: Path) -> dict[str, float]:
    """The largest difference of each network to its file, on three pictures."""
    painter, (network, predictor) = load_painter(), load_picture_styles()
    multistyle = running(read(folder, "multistyle26")[0])
    predict, transform = (running(dequantised(*read(folder, each))) for each in QUANTISED)
    pairs: dict[str, list[tuple[Tensor, np.ndarray]]] = {"styles": [], "vector": [], "painted": []}
    numbers = np.eye(len(painter.styles), dtype=np.float32)
    for phase in range(3):
        x = picture(128, 192, phase).movedim(-1, 0)[None]
        for k in range(phase, len(numbers), 3):
            own = painter.network(x, painter.styles[k])
            pairs["styles"].append((own, multistyle(x.numpy(), numbers[k])))
        seen, content = picture(SIDE, SIDE, phase), picture(384, 384, -phase)
        vector, expected = predictor(seen.movedim(-1, 0)[None]), predict(seen[None].numpy())
        pairs["vector"].append((vector, expected.reshape(1, -1)))
        style = predictor.affine(vector[0])
        own = network(content.movedim(-1, 0)[None], style).movedim(1, -1)
        pairs["painted"].append((own, transform(content[None].numpy(), expected)))
    return {k: max(float(np.abs(a.numpy() - b).max()) for a, b in v) for k, v in pairs.items()}


def main(folder: Path, target: Path) -> None:
    for name, weights in (("styles", of_styles(folder)), ("picture_style", of_pictures(folder))):
        tensors = {key: torch.from_numpy(weights[key].copy()) for key in sorted(weights)}
        save_file(tensors, target / f"{name}.safetensors")
    for name, difference in differences(folder).items():
        sys.stdout.write(f"{name}: {difference:.1e}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
