"""Shared by several files: a program as an editor, and tiny InstructPix2Pix models."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

import pytest

from gsedit.paper.editors.command import Command


@pytest.fixture
def program(tmp_path):
    """Makes a command that runs some Python, with words after it."""

    def make(code: str, words: str = "{input} {output} {prompt}", **options) -> Command:
        path = tmp_path / "a program.py"  # a space in the name: quoting must hold
        path.write_text(code)
        run = f"{shlex.quote(sys.executable)} {shlex.quote(str(path))} {words}"
        return Command(run, folder=tmp_path / "exchange", **options)

    return make


@pytest.fixture(scope="module")
def offline(tmp_path_factory):
    """No hub, and an empty cache of it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HF_HUB_OFFLINE", "1")
        patch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)
        patch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path_factory.mktemp("hub")))
        yield


@pytest.fixture(scope="session")
def pipeline(tmp_path_factory):
    from tiny_models import tiny_pipeline

    return tiny_pipeline(tmp_path_factory.mktemp("words"))


@pytest.fixture(scope="session")
def xl_pipeline(tmp_path_factory):
    from tiny_models import tiny_xl_pipeline

    return tiny_xl_pipeline(tmp_path_factory.mktemp("xl_words"))


@pytest.fixture(scope="session")
def xl_folder(xl_pipeline, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("models") / "tiny_xl"
    xl_pipeline.save_pretrained(path)
    return path


@pytest.fixture(scope="session")
def folder(pipeline, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("models") / "tiny"
    pipeline.save_pretrained(path)
    return path


@pytest.fixture(scope="session")
def model(folder):
    from gsedit.paper.models.loading import load_model

    return load_model(folder)
