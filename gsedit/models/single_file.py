"""Single-file checkpoints: told from their headers, and refused with how to make a folder of one.

They hold no settings and no tokenizer, which diffusers takes from the hub when it converts one.
"""

from __future__ import annotations

from pathlib import Path

from gsedit.models.headers import tensors

FIRST_LAYER = "model.diffusion_model.input_blocks.0.0.weight"
"""Name of a U-Net's first convolution in Stability AI's checkpoints."""
SECOND_ENCODER = "conditioner.embedders.1."
"""Beginning of the names of SDXL's second text encoder."""
EDM = "edm_vpred.sigma_max"
"""Name by which CosXL's checkpoints are told."""
COSXL_SCHEDULER = (
    "p.scheduler = diffusers.EDMEulerScheduler(sigma_min=0.002, sigma_max=120.0, sigma_data=1.0, "
    "prediction_type='v_prediction', sigma_schedule='exponential'); "
)


def refusal(path: Path) -> str:
    """The reason why a checkpoint in a single safetensors file is not loaded, with the next move.

    Raises InputError for a file that is cut short or no safetensors.
    """
    held = tensors(path)
    first = held.get(FIRST_LAYER)
    if first is None:
        return (
            f"{path} is a single file, and no checkpoint of Stable Diffusion: give a folder in "
            "diffusers' layout, with model_index.json"
        )
    if first.shape[1:2] != (8,):
        return (
            f"{path} is no InstructPix2Pix model (its unet takes {first.shape[1]} channels, not "
            "8): one of that kind is timbrooks/instruct-pix2pix"
        )
    xl = "XL" if any(name.startswith(SECOND_ENCODER) for name in held) else ""
    options = ", is_cosxl_edit=True" if EDM in held else ""
    scheduler = COSXL_SCHEDULER if EDM in held else ""
    return (
        f"{path} is a single file, without the settings and the tokenizer that are needed: where "
        f'there is a network, run: python -c "import diffusers; '
        f"p = diffusers.StableDiffusion{xl}InstructPix2PixPipeline.from_single_file('{path}', "
        f"num_in_channels=8{options}); {scheduler}p.save_pretrained('FOLDER')\"; then add "
        "--model FOLDER"
    )
