"""Write the weights of U2-Net-p, from its ONNX file, as gsedit ships them.

    python -m research.convert_u2net u2netp.onnx gsedit/select/u2net.safetensors

The graph holds the convolutions, with their normalisations folded in, in the order in which they
are applied. Needs onnx. In half precision masks would move by up to 0.1.
"""

from __future__ import annotations

import sys
from pathlib import Path

import onnx  # pyright: ignore[reportMissingImports]
import torch
from onnx import numpy_helper  # pyright: ignore[reportMissingImports]
from safetensors.torch import save_file

from gsedit.select.subject import Block, U2Net


def in_order(network: U2Net) -> list[torch.nn.Module]:
    """Convolutions in the order in which the network applies them."""

    def of(block: Block) -> list[torch.nn.Module]:
        return [block.first, *block.down, *reversed(block.up)]

    blocks = [each for each in (*network.down, *reversed(network.up)) if isinstance(each, Block)]
    return [*(conv for block in blocks for conv in of(block)), *network.sides, network.joined]


def main(source: Path, target: Path) -> None:
    graph = onnx.load(str(source)).graph
    values = {each.name: numpy_helper.to_array(each) for each in graph.initializer}
    network = U2Net()
    convolutions = [node for node in graph.node if node.op_type == "Conv"]
    for layer, node in zip(in_order(network), convolutions, strict=True):
        weight, bias = (torch.from_numpy(values[name].copy()) for name in node.input[1:])
        layer.load_state_dict({"weight": weight, "bias": bias})
    save_file({k: v.contiguous() for k, v in network.state_dict().items()}, target)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
