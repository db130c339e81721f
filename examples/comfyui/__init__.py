"""Node of ComfyUI: a scene of Gaussians in, a sentence, the edited scene and pictures of it out.

Install gsedit in ComfyUI's Python and link or copy this folder into ComfyUI/custom_nodes. Scenes
travel as paths of their files, as ComfyUI's nodes for splats pass them.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import torch

import gsedit
from gsedit.views.around import around
from rasterizer import render

PICTURES = 4
"""Views that are drawn of the result, spread over those that were found."""


class EditScene:
    """Edit a captured 3D scene from a sentence."""

    CATEGORY = "3d/gsedit"
    FUNCTION = "edit"
    RETURN_TYPES = ("STRING", "IMAGE")
    RETURN_NAMES = ("ply_path", "views")
    OUTPUT_NODE = True

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:
        """Sockets and widgets, as ComfyUI asks for them."""
        sentence = {"default": "turn it into a bronze statue", "multiline": True}
        seed = {"default": 0, "min": 0, "max": 2**32 - 1}
        return {
            "required": {
                "ply_path": ("STRING", {"default": "scene.ply"}),
                "sentence": ("STRING", sentence),
                "seed": ("INT", seed),
            }
        }

    @classmethod
    def IS_CHANGED(cls, ply_path: str, **_: Any) -> str:
        """Digest of the scene's file: a node is not run again for the same content."""
        return hashlib.sha256(Path(ply_path).read_bytes()).hexdigest()

    def edit(self, ply_path: str, sentence: str, seed: int) -> tuple[str, torch.Tensor]:
        """Write the edited scene; pictures [n, h, w, 3] in [0, 1] are of views around it.

        Raises UsageError for a sentence that is refused, InputError for a file that is no scene.
        """
        scene = gsedit.load(ply_path)
        views = around(scene)
        generator = torch.Generator().manual_seed(seed)
        result = gsedit.edit(scene, sentence, views=views, generator=generator)
        name = hashlib.sha256(f"{ply_path}\n{sentence}\n{seed}".encode()).hexdigest()[:8]
        made = _output_folder() / f"{Path(ply_path).stem}-{name}.ply"
        gsedit.save(result.scene, made, overwrite=True)
        cameras = [view.camera for view in views.views][:: max(1, len(views.views) // PICTURES)]
        with torch.no_grad():
            drawn = [render(result.scene, each).color.clamp(0, 1).float() for each in cameras]
        return str(made), torch.stack(drawn[:PICTURES])


def _output_folder() -> Path:
    """The folder that ComfyUI writes results to; the present one outside of ComfyUI."""
    try:
        import folder_paths  # pyright: ignore[reportMissingImports]
    except ImportError:
        return Path()
    return Path(folder_paths.get_output_directory())


NODE_CLASS_MAPPINGS = {"gsedit.EditScene": EditScene}
NODE_DISPLAY_NAME_MAPPINGS = {"gsedit.EditScene": "Edit a scene from a sentence (gsedit)"}
