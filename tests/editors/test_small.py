"""The small editor: words, network, denoiser and files. Most laws hold for any weights."""

from __future__ import annotations

import json
import zlib
from dataclasses import asdict

import pytest
import torch

from gsedit.diffusion import Need, SamplerSettings, predict_guided
from gsedit.editors.protocol import EditBatch
from gsedit.editors.sampling import DiffusionEditor
from gsedit.editors.small import Architecture, Network, Small, load_small, save_small
from gsedit.editors.small.denoiser import NOISE, schedule
from gsedit.editors.small.network import CELL, CHANNELS, SPREAD
from gsedit.editors.small.text import ROWS, WORDS, pieces_of, tokenise, words_of
from gsedit.errors import InputError, UsageError

TINY = Architecture(
    eye=(32, 32, 64), hand=(16, 32), attended=1, pixel=4, perceptron=8, embedding=32, text_width=32,
    text_layers=1,
)  # fmt: skip


def stirred(architecture: Architecture = TINY, seed: int = 0) -> Network:
    """A network none of whose layers is zero, as after training."""
    torch.manual_seed(seed)
    network = Network(architecture).eval().requires_grad_(False)
    for name, value in network.named_parameters():
        if value.dim() > 1 and not value.any():
            torch.nn.init.normal_(value, std=0.02)
        elif not name.endswith("norm.weight"):
            value += 0.01 * torch.randn(value.shape)
    return network


@pytest.fixture(scope="module")
def small() -> Small:
    return Small(stirred())


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def pictures(views: int, height: int, width: int) -> torch.Tensor:
    return torch.rand(views, height, width, 3, generator=torch.Generator().manual_seed(1))


# ---- words ---------------------------------------------------------------------------------------


def test_words_are_read_without_case_and_punctuation():
    assert words_of('Turn it into a "Bronze" statue, please!') == [
        "turn", "it", "into", "a", "bronze", "statue", "please"
    ]  # fmt: skip


def test_a_piece_is_the_same_in_every_process():
    assert pieces_of("it")[0] == 1 + zlib.crc32(b"<it>") % (ROWS - 1)
    assert len(set(pieces_of("bronze"))) > 8
    assert all(0 < row < ROWS for row in pieces_of("bronze"))


def test_words_that_look_alike_share_pieces():
    bronze, bronzed, blue = (set(pieces_of(word)) for word in ("bronze", "bronzed", "blue"))
    assert len(bronze & bronzed) > len(bronze) / 2
    assert len(bronze & blue) <= 1  # a collision may happen


@pytest.mark.parametrize("sentence", ["", "?!", "日本語", "x" * 1000, "word " * 1000, "ünïcödé 🎉"])
def test_any_text_has_tokens_and_a_finite_vector(small, sentence):
    tokens = tokenise([sentence])
    assert tokens.pieces.shape[1] == WORDS
    assert torch.isfinite(small.network.text(tokens)).all()


def test_a_sentence_does_not_depend_on_its_neighbours(small):
    sentences = ["make it snow", "as a bronze statue in the middle of the night", ""]
    together = small.network.text(tokenise(sentences))
    alone = torch.cat([small.network.text(tokenise([each])) for each in sentences])
    torch.testing.assert_close(together, alone, atol=1e-5, rtol=1e-5)


def test_the_order_of_words_matters(small):
    first, second = small.network.text(tokenise(["red on blue", "blue on red"]))
    assert not torch.allclose(first, second, atol=1e-4)


# ---- the network ---------------------------------------------------------------------------------


def asked(network, x, sigma, picture, shown=1.0, sentence="as a bronze statue"):
    n = len(x)
    told, given = network.text(tokenise([sentence] * n)), torch.full((n,), shown)
    return network(x, torch.full((n,), sigma), picture, given, network.look(picture, given), told)


def test_an_untrained_network_answers_the_picture_where_all_is_noise():
    torch.manual_seed(0)
    x, picture = noise(2, CHANNELS, 8, 8), noise(2, CHANNELS, 8, 8, seed=1)
    answer = asked(Network(TINY), x, 1e6, picture)
    torch.testing.assert_close(answer, picture, atol=1e-4, rtol=1e-4)


def test_what_is_hardly_noised_is_kept(small):
    x, picture = noise(2, CHANNELS, 8, 8), noise(2, CHANNELS, 8, 8, seed=1)
    answer = asked(small.network, x, 1e-4 * SPREAD, picture)
    torch.testing.assert_close(answer, x, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (5, 3), (8, 8), (33, 17)])
@pytest.mark.parametrize("sigma", [1e-4, 0.1, 4.0, 1e4])
def test_any_size_and_noise_has_a_finite_answer(small, shape, sigma):
    x, picture = noise(1, CHANNELS, *shape), noise(1, CHANNELS, *shape, seed=1)
    answer = asked(small.network, x, sigma, picture)
    assert answer.shape == x.shape
    assert torch.isfinite(answer).all()


def test_the_eye_sees_every_pixel(small):
    seen = small.network.look(noise(2, CHANNELS, 5, 7), torch.ones(2))
    assert seen.geometry.shape == (2, 3, 20, 28)
    assert seen.features.shape[-2:] == (5, 7)


def test_a_picture_that_is_not_shown_is_not_seen(small):
    x = noise(1, CHANNELS, 8, 8)
    one, other = noise(1, CHANNELS, 8, 8, seed=1), noise(1, CHANNELS, 8, 8, seed=2)
    blind = [asked(small.network, x, 1.0, picture, 0.0) for picture in (one, other)]
    assert torch.equal(*blind)
    assert not torch.equal(*(asked(small.network, x, 1.0, picture) for picture in (one, other)))


def test_words_decide(small):
    x, picture = noise(1, CHANNELS, 8, 8), noise(1, CHANNELS, 8, 8, seed=1)
    red, blue = (asked(small.network, x, 9.0, picture, sentence=s) for s in ("red", "blue"))
    assert not torch.allclose(red, blue, atol=1e-6)


def test_views_do_not_see_each_other(small):
    x, picture = noise(3, CHANNELS, 8, 8), noise(3, CHANNELS, 8, 8, seed=1)
    together = asked(small.network, x, 1.0, picture)
    alone = [asked(small.network, x[i : i + 1], 1.0, picture[i : i + 1]) for i in range(3)]
    torch.testing.assert_close(together, torch.cat(alone), atol=1e-4, rtol=1e-4)


# ---- the denoiser --------------------------------------------------------------------------------


def test_the_latent_is_the_picture(small):
    images = pictures(2, 16, 24)
    latents = small.encode(images)
    assert latents.shape == (2, small.channels, 16 // CELL, 24 // CELL)
    torch.testing.assert_close(small.decode(latents), images)
    torch.testing.assert_close(latents.norm(), (2 * images - 1).norm())


def test_the_schedule_goes_from_hardly_any_noise_to_nothing_else():
    assert schedule().level(0).sigma < 1e-2
    assert schedule().level(500).sigma == pytest.approx(NOISE, rel=0.01)
    assert schedule().level(999).sigma > 1000


@pytest.mark.parametrize(
    "need", [Need(), Need(True, False, False), Need(False, True, True), Need(True, True, False)]
)
def test_only_what_is_needed_is_answered_and_alike(small, need):
    originals = pictures(3, 16, 16)
    condition = small.condition(originals, "make it snow", torch.Generator())
    x = noise(3, CHANNELS, 4, 4)
    every = small.branches(x, 500.0, condition, Need())
    some = small.branches(x, 500.0, condition, need)
    for wanted, expected, found in zip(need, every, some):
        assert (found is not None) == wanted
        if found is not None:
            torch.testing.assert_close(found, expected, atol=1e-4, rtol=1e-4)


def test_micro_batches_change_nothing():
    network = stirred()
    originals, x = pictures(5, 16, 16), noise(5, CHANNELS, 4, 4)
    answers = []
    for size in (1, 2, 5):
        model = Small(network, micro_batch=size)
        condition = model.condition(originals, "make it snow", torch.Generator())
        answers.append(
            predict_guided(model, condition, x, model.schedule.level(500), SamplerSettings())
        )
    for other in answers[1:]:
        torch.testing.assert_close(other, answers[0], atol=1e-3, rtol=1e-3)


def test_words_are_counted_as_they_are_read(small):
    with pytest.raises(UsageError, match=f"26 words and this editor reads {WORDS}"):
        small.check("black-and-white " * 8 + "it all")


@pytest.mark.parametrize("prompt", ["", "  ", "?!"])
def test_an_instruction_without_words_is_refused(small, prompt):
    with pytest.raises(UsageError, match="the instruction is empty: say what to change"):
        small.check(prompt)


def test_an_instruction_that_is_too_long_is_refused(small):
    with pytest.raises(UsageError, match=f"30 words and this editor reads {WORDS}"):
        small.check("word " * 30)


def test_a_sentence_without_any_word_it_was_taught_is_remarked_on():
    small = Small(stirred(), looks=("bronze", "snow"), words=frozenset({"bronze", "snowy"}))
    assert small.advise("Make it SNOWY!") == ""
    assert "no word of 'as a dinosaur' names a look" in small.advise("as a dinosaur")
    assert "it was taught bronze, snow. For any sentence: --editor pix2pix" in small.advise("zxqv")


def edit(editor, images, prompt="as a bronze statue", seed=0, **settings):
    batch = EditBatch(images=images, originals=images, prompt=prompt)
    chosen = SamplerSettings(**{"steps": 3} | settings)
    *_, last = editor.edit(batch, chosen, torch.Generator().manual_seed(seed))
    return last.images


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_black_and_white_pictures_are_edited(small, value):
    edited = edit(DiffusionEditor(small), torch.full((2, 32, 32, 3), value), steps=20)
    assert torch.isfinite(edited).all()
    assert edited.min() >= 0
    assert edited.max() <= 1


def test_sixty_four_views_are_edited_at_once(small):
    edited = edit(DiffusionEditor(small), pictures(64, 16, 16))
    assert edited.shape == (64, 16, 16, 3)
    assert torch.isfinite(edited).all()


@pytest.mark.parametrize("size", [(4, 4), (5, 7), (30, 18)])
def test_odd_sizes_come_back_as_they_were(small, size):
    assert edit(DiffusionEditor(small), pictures(1, *size)).shape == (1, *size, 3)


def test_words_nobody_taught_degrade_and_do_not_crash(small):
    edited = edit(DiffusionEditor(small), pictures(1, 32, 32), "zxqv blorf the wug 日本")
    assert torch.isfinite(edited).all()


@pytest.mark.parametrize("other", [{"guidance_text": 7.5}, {"temperature": 1.0}])
def test_what_suits_it_is_used_unless_something_else_is_asked_for(small, other):
    editor, images = DiffusionEditor(small), pictures(1, 16, 16)
    assert torch.equal(edit(editor, images), edit(editor, images, **small.suits._asdict()))
    assert not torch.equal(edit(editor, images), edit(editor, images, **other))


@pytest.mark.parametrize(("temperature", "chance"), [(0.0, False), (0.5, True), (1.0, True)])
def test_without_noise_there_is_no_chance(small, temperature, chance):
    editor, images = DiffusionEditor(small), pictures(1, 16, 16)
    first, second = (edit(editor, images, seed=s, temperature=temperature) for s in (0, 1))
    assert torch.equal(first, second) is not chance


# ---- files ---------------------------------------------------------------------------------------


def test_weights_come_back_in_half_precision(tmp_path):
    small = Small(stirred(), looks=("bronze", "snow"), words=frozenset({"bronze", "snowy"}))
    save_small(small, tmp_path / "tiny.safetensors", {"seed": "3"})
    found = load_small(tmp_path / "tiny.safetensors")
    assert found.network.architecture == TINY
    assert (found.looks, found.words) == (small.looks, small.words)
    for name, value in small.network.state_dict().items():
        assert torch.equal(found.network.state_dict()[name], value.half().float())


def test_weights_that_are_missing_say_where(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.safetensors: no such file; leave --model out"):
        load_small(tmp_path / "nowhere.safetensors")


def test_a_folder_is_no_file_of_weights(tmp_path):
    with pytest.raises(InputError, match=r"is a folder and no file.*need --editor pix2pix"):
        load_small(tmp_path)


def test_weights_that_were_written_anew_are_read_anew(tmp_path):
    path = tmp_path / "tiny.safetensors"
    for seed in (0, 1):
        save_small(Small(stirred(seed=seed)), path)
        found = load_small(path).network.state_dict()["rest.weight"]
        assert torch.equal(found, stirred(seed=seed).rest.weight.half().float())


def test_a_broken_file_is_named(tmp_path):
    path = tmp_path / "broken.safetensors"
    path.write_bytes(b"not weights at all")
    with pytest.raises(InputError, match=r"broken\.safetensors does not hold the weights"):
        load_small(path)


def test_weights_of_another_network_are_refused(tmp_path):
    from safetensors.torch import save_file

    path = tmp_path / "other.safetensors"
    told = {"architecture": json.dumps(asdict(TINY)), "looks": "[]", "words": "[]"}
    save_file({"a": torch.zeros(1)}, path, told)
    with pytest.raises(InputError, match="does not hold the weights of the small editor"):
        load_small(path)
