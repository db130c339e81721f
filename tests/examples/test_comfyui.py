"""The node of ComfyUI, loaded and called as ComfyUI does."""

import importlib.util
from pathlib import Path

import pytest
import torch
from scenes import random_cloud

import gsedit

FILE = Path(__file__).parents[2] / "examples" / "comfyui" / "__init__.py"


@pytest.fixture(scope="module")
def loaded():
    """The package, imported from its folder under a name that ComfyUI chooses."""
    spec = importlib.util.spec_from_file_location("custom_nodes.gsedit_node", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_graph_runs_the_node(loaded, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    gsedit.save(random_cloud(300, 0), "scene.ply")
    for name, node in loaded.NODE_CLASS_MAPPINGS.items():
        assert name in loaded.NODE_DISPLAY_NAME_MAPPINGS
        inputs = {
            key: options.get("default")
            for key, (_, options) in node.INPUT_TYPES()["required"].items()
        }
        inputs["sentence"] = "make it darker"
        outputs = getattr(node(), node.FUNCTION)(**inputs)
        assert len(outputs) == len(node.RETURN_TYPES) == len(node.RETURN_NAMES)
        path, views = outputs
        assert gsedit.load(path).means.shape[0] == 300
        assert views.ndim == 4
        assert views.shape[-1] == 3
        assert views.dtype == torch.float32
        assert 0 <= views.min() <= views.max() <= 1
        digest = node.IS_CHANGED(**inputs)
        assert (
            digest == node.IS_CHANGED(**inputs) != node.IS_CHANGED(**{**inputs, "ply_path": path})
        )


def test_a_sentence_that_is_refused_is_an_error_of_the_graph(loaded, tmp_path):
    gsedit.save(random_cloud(30, 0), tmp_path / "scene.ply")
    node = loaded.EditScene()
    with pytest.raises(gsedit.UsageError):
        node.edit(str(tmp_path / "scene.ply"), "", 0)
