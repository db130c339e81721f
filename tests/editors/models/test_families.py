"""The table of families against diffusers' own pipelines, and models of each in small files."""

from __future__ import annotations

import inspect as python_inspect
import json

import diffusers
import pytest
import transformers

from gsedit.errors import InputError
from gsedit.models.families import FAMILIES, PIPELINES, SD, SDXL
from gsedit.models.layout import chosen, identify
from gsedit.models.weights import inspect

NEVER_USED = {"safety_checker", "feature_extractor", "image_encoder"}


@pytest.mark.parametrize("name", PIPELINES)
def test_components_are_those_of_diffusers_pipeline(name):
    parameters = python_inspect.signature(getattr(diffusers, name)).parameters.values()
    needed = {each.name for each in parameters if each.default is each.empty} - NEVER_USED
    assert {each.name for each in PIPELINES[name].components} == needed


def test_every_class_exists():
    libraries = {"network": diffusers, "scheduler": diffusers, "encoder": transformers}
    for component in (each for family in FAMILIES for each in family.components):
        for name in component.classes:
            assert hasattr(libraries[component.role], name), name


def configs(pipeline: str) -> dict[str, dict]:
    """The JSON files of a model of that pipeline."""
    family = PIPELINES[pipeline]
    files: dict[str, dict] = {"model_index.json": {"_class_name": pipeline}}
    for component in family.components:
        kind = component.classes[0] if component.classes else "AnyTokenizer"
        files["model_index.json"][component.name] = ["library", kind]
        match component.role:
            case "network":
                files[f"{component.name}/config.json"] = {"_class_name": kind}
            case "encoder":
                files[f"{component.name}/config.json"] = {"architectures": [kind]}
            case "scheduler":
                files["scheduler/scheduler_config.json"] = {"_class_name": kind}
    return files


@pytest.mark.parametrize("name", PIPELINES)
def test_a_model_is_told_by_its_names_and_every_other_class_is_refused(name):
    files = configs(name)
    kind = identify("a/model", files.get)
    assert (kind.family, kind.pipeline) == (PIPELINES[name], name)
    for component in kind.family.components:
        if component.role == "words":
            continue
        other = json.loads(json.dumps(files))
        other["model_index.json"][component.name][1] = "SomethingElse"
        with pytest.raises(InputError, match=f"its {component.name} is of the class SomethingElse"):
            identify("a/model", other.get)


@pytest.mark.parametrize("name", PIPELINES)
def test_the_folder_of_each_family_is_inspected(tmp_path, name):
    """Without weights every part with weights is a problem, named; nothing else is."""
    for file, config in configs(name).items():
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text(json.dumps(config | {"in_channels": 8}))
    found = inspect(tmp_path)
    family = PIPELINES[name]
    problems = {part.name for part in found.parts if part.problems}
    assert problems == {c.name for c in family.components if c.role != "scheduler"}
    assert all("download" in problem for problem in found.problems)


def test_other_pipelines_are_refused_with_what_works():
    with pytest.raises(InputError) as caught:
        identify("someone/video", {"model_index.json": {"_class_name": "WanPipeline"}}.get)
    message = str(caught.value)
    assert message.startswith("someone/video is a WanPipeline, which gsedit does not edit with")
    assert all(name in message for name in PIPELINES)
    assert "\n" not in message


def test_an_old_folder_is_told_by_its_unet():
    for more, family in (({}, SD), ({"addition_embed_type": "text_time"}, SDXL)):
        files = {"unet/config.json": {"in_channels": 8} | more}
        assert identify("old", files.get).family == family
    with pytest.raises(InputError, match=r"neither model_index\.json nor unet/config\.json"):
        identify("nothing", {}.get)


STEM = "diffusion_pytorch_model"


@pytest.mark.parametrize(
    ("names", "weights", "variant"),
    [
        ((".safetensors", ".fp16.safetensors", ".bin"), 1, None),
        ((".fp16.safetensors", ".non_ema.safetensors"), 1, "fp16"),
        (("-00001-of-00002.safetensors", "-00002-of-00002.safetensors"), 2, None),
        (("-00001-of-00001.fp16.safetensors",), 1, "fp16"),
        ((".bin", ".other.safetensors"), 0, None),
    ],
)
def test_one_precision_is_chosen_and_no_pickle(names, weights, variant):
    """The first `weights` names are those that are chosen."""
    full = [f"unet/{STEM}{name}" for name in names]
    found = chosen(SD.network, [*full, "unet/config.json", "vae/config.json"])
    assert list(found.weights) == full[:weights]
    assert found.variant == variant
    assert found.settings == ("unet/config.json",)
