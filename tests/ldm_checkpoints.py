"""Single-file checkpoints by the names of Stability AI's code, made of diffusers' networks."""

from __future__ import annotations

import re
from typing import Any

import torch
from torch import Tensor

Weights = dict[str, Tensor]
RESNET = {
    "norm1": "in_layers.0", "conv1": "in_layers.2", "norm2": "out_layers.0",
    "conv2": "out_layers.3", "time_emb_proj": "emb_layers.1", "conv_shortcut": "skip_connection",
}  # fmt: skip
UNET = {
    "time_embedding.linear_1": "time_embed.0", "time_embedding.linear_2": "time_embed.2",
    "add_embedding.linear_1": "label_emb.0.0", "add_embedding.linear_2": "label_emb.0.2",
    "conv_in": "input_blocks.0.0", "conv_norm_out": "out.0", "conv_out": "out.2",
}  # fmt: skip
ATTENTION = {
    "group_norm": "norm", "to_q": "q", "to_k": "k", "to_v": "v", "to_out.0": "proj_out",
}  # fmt: skip
CLIP = {
    "encoder.layers": "transformer.resblocks", "self_attn.out_proj": "attn.out_proj",
    "layer_norm1": "ln_1", "layer_norm2": "ln_2", "fc1": "c_fc", "fc2": "c_proj",
    "embeddings.token_embedding": "token_embedding", "final_layer_norm": "ln_final",
    "embeddings.position_embedding.weight": "positional_embedding",
}  # fmt: skip


def checkpoint_of(pipe: Any) -> Weights:
    """All weights of a pipeline of InstructPix2Pix, of Stable Diffusion 1.5 or SDXL."""
    first = {_with_model(name): value for name, value in pipe.text_encoder.state_dict().items()}
    held = _prefixed("model.diffusion_model.", _unet(pipe.unet))
    held |= _prefixed("first_stage_model.", _vae(pipe.vae))
    if not hasattr(pipe, "text_encoder_2"):
        return held | _prefixed("cond_stage_model.transformer.", first)
    held |= _prefixed("conditioner.embedders.0.transformer.", first)
    second = _open_clip(pipe.text_encoder_2.state_dict())
    held |= _prefixed("conditioner.embedders.1.model.", second)
    return {name: value.contiguous() for name, value in held.items()}


def _unet(unet: Any) -> Weights:
    per = unet.config.layers_per_block + 1

    def renamed(name: str) -> str:
        for new, old in UNET.items():
            if name.startswith(new + "."):
                return old + name.removeprefix(new)
        if found := re.match(r"(down|up)_blocks\.(\d+)\.(resnets|attentions)\.(\d+)\.(.*)", name):
            side, block, what, layer, rest = found.groups()
            number = int(block) * per + int(layer) + (side == "down")
            place = f"{'in' if side == 'down' else 'out'}put_blocks.{number}"
            return f"{place}.{'01'[what == 'attentions']}.{_mapped(rest, RESNET, what)}"
        if found := re.match(r"(down|up)_blocks\.(\d+)\.(?:down|up)samplers\.0\.conv\.(.*)", name):
            side, block, rest = found.groups()
            if side == "down":
                return f"input_blocks.{(int(block) + 1) * per}.0.op.{rest}"
            has_attention = f"up_blocks.{block}.attentions.0.norm.weight" in unet.state_dict()
            return f"output_blocks.{(int(block) + 1) * per - 1}.{1 + has_attention}.conv.{rest}"
        what, layer, rest = re.match(r"mid_block\.(resnets|attentions)\.(\d+)\.(.*)", name).groups()
        number = 1 if what == "attentions" else 2 * int(layer)
        return f"middle_block.{number}.{_mapped(rest, RESNET, what)}"

    return {renamed(name): value for name, value in unet.state_dict().items()}


def _vae(vae: Any) -> Weights:
    last = len(vae.config.up_block_types) - 1
    held = {}
    for name, value in vae.state_dict().items():
        if ".attentions.0." in name:
            name = _mapped(name.replace("mid_block.attentions.0", "mid.attn_1"), ATTENTION)
            value = value[:, :, None, None] if value.ndim == 2 else value
        name = re.sub(r"mid_block\.resnets\.(\d)", lambda m: f"mid.block_{int(m[1]) + 1}", name)
        name = re.sub(r"up_blocks\.(\d)", lambda m: f"up.{last - int(m[1])}", name)
        name = re.sub(r"down_blocks\.(\d)", r"down.\1", name).replace("resnets", "block")
        name = re.sub("(down|up)samplers.0", r"\1sample", name)
        name = name.replace("conv_norm_out", "norm_out").replace("conv_shortcut", "nin_shortcut")
        held[name] = value
    return held


def _open_clip(weights: Weights) -> Weights:
    held: Weights = {"text_projection": weights["text_projection.weight"].T.contiguous()}
    joined: dict[str, list[Tensor]] = {}
    for name, value in weights.items():
        name = name.removeprefix("text_model.")
        if found := re.match(r"encoder\.layers\.(\d+)\.self_attn\.[qkv]_proj\.(weight|bias)", name):
            layer, kind = found.groups()
            place = f"transformer.resblocks.{layer}.attn.in_proj_{kind}"
            joined.setdefault(place, []).append(value)  # k, q, v: sorted below
        elif name != "text_projection.weight":
            name = _mapped(name, CLIP)
            held[re.sub(r"\.(c_fc|c_proj)", r".mlp.\1", name).replace("mlp.mlp", "mlp")] = value
    order = [name[name.index("self_attn") + 10] for name in weights if "layers.0.self_attn" in name]
    order = [each for each in dict.fromkeys(order) if each in "qkv"]
    for place, values in joined.items():
        held[place] = torch.cat([values[order.index(each)] for each in "qkv"])
    return held


def _mapped(name: str, names: dict[str, str], what: str = "resnets") -> str:
    """The name with its parts exchanged; of attentions of a U-Net they are the same in both."""
    for new, old in names.items() if what == "resnets" else ():
        name = name.replace(new, old)
    return name


def _with_model(name: str) -> str:
    return f"text_model.{name.removeprefix('text_model.')}"


def _prefixed(prefix: str, weights: Weights) -> Weights:
    return {prefix + name: value for name, value in weights.items()}
