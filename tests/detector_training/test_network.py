"""The parts of training that need PyTorch; `make test-training` installs it and runs them."""

import json
import math
import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

if "PYTEST_XDIST_WORKER" in os.environ:
    # PyTorch's Triton and Mesa, which renders for others, bring an LLVM each: together they end a process.
    pytest.skip("beside other tests PyTorch is not loaded: make test-training", allow_module_level=True)
torch = pytest.importorskip("torch", reason="PyTorch is not installed: make test-training")

from crowdfence.detector_training.augmentation import _focused, varied  # noqa: E402
from crowdfence.detector_training.clutter import cluttered, free_of_people, furnished  # noqa: E402
from crowdfence.detector_training.crops import Batch, CropPlan, CropSampler  # noqa: E402
from crowdfence.detector_training.foliage import crowns  # noqa: E402
from crowdfence.detector_training.frame_store import StoredMission  # noqa: E402
from crowdfence.detector_training.loss import crowd_loss  # noqa: E402
from crowdfence.detector_training.network import CrowdNet  # noqa: E402
from crowdfence.detector_training.onnx_import import freeze_statistics, import_onnx, measure_statistics  # noqa: E402
from crowdfence.detector_training.patterns import panels  # noqa: E402
from crowdfence.detector_training.photography import (  # noqa: E402
    _softened,
    photographed,
    with_swapped_amplitudes,
)
from crowdfence.detector_training.plan import TrainingPlan  # noqa: E402
from crowdfence.detector_training.recolouring import recoloured  # noqa: E402
from crowdfence.detector_training.report import training_facts, write_report  # noqa: E402
from crowdfence.detector_training.resident_crops import ResidentCrops  # noqa: E402
from crowdfence.detector_training.trainer import Checkup, Teacher, train  # noqa: E402
from crowdfence.detector_training.validation import ValidationScore, validate  # noqa: E402
from crowdfence.evaluation.cells.rates import Confusion  # noqa: E402

CPU = torch.device("cpu")


def squares(seed: int, frames: int = 6, height: int = 96, width: int = 128) -> StoredMission:
    """Dark, noisy frames with one bright square that is the crowd; known everywhere."""
    rng = np.random.default_rng(seed)
    images = rng.integers(0, 60, (frames, height, width, 3), np.uint8)
    crowd = np.zeros((frames, 1, height // 2, width // 2), np.uint8)
    for frame in range(frames):
        row, column = rng.integers(0, height // 4 - 8), rng.integers(0, width // 4 - 8)
        crowd[frame, 0, 2 * row : 2 * row + 16, 2 * column : 2 * column + 16] = 255
        images[frame, 4 * row : 4 * row + 32, 4 * column : 4 * column + 32] += 150
    return StoredMission(f"squares-{seed}", images, crowd, np.ones(crowd.shape, np.bool_), ())


PLAN = TrainingPlan(
    targets=("silhouettes",),
    width=0.25,
    steps=150,
    learning_rate=1e-2,
    batch=4,
    warm_up_steps=5,
    validate_every=50,
    crops=CropPlan(height=64, width=64, scale=(0.8, 1.3)),
    average_decay=0.8,
)


def test_crowdnet_s_keeps_its_promises():
    network = CrowdNet(1)
    assert sum(value.numel() for value in network.deployed(0).parameters()) <= 700_000
    with torch.no_grad():
        logits = network.eval()(torch.zeros(2, 3, 240, 320))
    assert logits.shape == (2, 1, 60, 80)
    assert float(torch.sigmoid(logits).mean()) < 0.3  # starts where most cells are: empty


@pytest.fixture(params=[CropSampler, ResidentCrops])
def source(request):
    """Makes crops one by one, or side by side of frames in the memory of the device."""
    return request.param


def test_a_crop_shows_the_crowd_where_its_label_says(source):
    sampler = source([squares(1)], CropPlan(height=64, width=96, scale=(0.5, 2.0), rotation_deg=30.0), CPU)
    rng = np.random.default_rng(2)
    for _ in range(10):
        batch = sampler.draw(4, rng)
        assert batch.image.shape == (4, 3, 64, 96) and batch.crowd.shape == (4, 1, 16, 24)
        bright = torch.nn.functional.avg_pool2d(batch.image.mean(dim=1, keepdim=True), 4)
        crowd, known = batch.crowd > 0, batch.known > 0
        # Cells at the edge of a square are half bright; all others agree.
        inner = torch.nn.functional.avg_pool2d(batch.crowd, 3, 1, 1)
        assert (bright[(inner > 0.99) & known] > 0.4).all()
        assert (bright[(inner < 0.01) & known] < 0.3).all()
        assert crowd.any()
        brightest = torch.nn.functional.max_pool2d(batch.image.amax(dim=1, keepdim=True), 4)
        assert not known[brightest == 0.0].any()  # black is outside the frame: frames have noise everywhere


def test_a_crop_is_as_sharp_as_its_frame(source):
    """Stripes with a period of 4 pixels, moved by a part of one: bilinear values lose up to 1 - cos(45 deg)
    = 29 % of their contrast, bicubic ones up to 1 - 2 * (0.59375 + 0.09375) * cos(45 deg) = 2.8 %."""
    stripes = (128 + 100 * np.cos(np.arange(128) * math.pi / 2)).astype(np.uint8)
    images = np.broadcast_to(stripes[None, None, :, None], (2, 96, 128, 3)).copy()
    labels = np.zeros((2, 1, 48, 64), np.uint8)
    frames = StoredMission("stripes", images, labels, np.ones(labels.shape, np.bool_), ())
    sampler = source([frames], CropPlan(height=48, width=64, scale=(1.0, 1.0), rotation_deg=0.0), CPU)
    rng = np.random.default_rng(3)
    wave = torch.exp(-0.5j * math.pi * torch.arange(56.0))
    for _ in range(10):
        rows = sampler.draw(2, rng).image[:, 0, 20, 4:60]
        amplitude = (rows * wave).mean(dim=1).abs() * 2.0 * 255.0
        assert (amplitude > 96.5).all() and (amplitude < 101.0).all()


def test_labels_of_small_crowds_survive_the_turn_of_a_crop(source):
    """White discs of 5 pixels: what is white in half of a cell's pixels is what the label says."""
    rng = np.random.default_rng(4)
    rows, columns = np.mgrid[:96, :128] + 0.5
    images = np.full((4, 96, 128, 3), 5, np.uint8)
    for image in images:
        for row, column in rng.uniform((0, 0), (96, 128), (12, 2)):
            image[(rows - row) ** 2 + (columns - column) ** 2 < 25.0] = 255
    share = (images[:, None, :, :, 0] > 127).reshape(4, 1, 48, 2, 64, 2).mean(axis=(3, 5))
    labels = np.rint(share * 255).astype(np.uint8)
    frames = StoredMission("discs", images, labels, np.ones(labels.shape, np.bool_), ())
    sampler = source([frames], CropPlan(height=64, width=64, scale=(0.6, 1.6), rotation_deg=20.0), CPU)
    both = either = 0
    for _ in range(30):
        batch = sampler.draw(4, rng)
        white = torch.nn.functional.avg_pool2d((batch.image[:, :1] > 0.5).float(), 4) >= 0.5
        crowd, known = batch.crowd > 0.5, batch.known > 0.5
        both += int((crowd & white & known).sum())
        either += int(((crowd | white) & known).sum())
    assert either > 1000
    assert both > 0.9 * either  # labels that are no finer than cells reach .81 to .86


def test_unknown_cells_and_cells_outside_the_frame_teach_nothing():
    logits = torch.tensor([[[[5.0, -5.0], [0.0, 9.0]]]])
    crowd = torch.tensor([[[[1.0, 0.0], [1.0, 0.0]]]])
    known = torch.tensor([[[[1.0, 1.0], [1.0, 0.0]]]])
    by_hand = (2 * math.log1p(math.exp(-5.0)) + math.log(2.0)) / 3
    assert float(crowd_loss(logits, crowd, known, dice_weight=0.0)) == pytest.approx(by_hand, rel=1e-5)
    p = 1 / (1 + math.exp(-5.0))
    dice = (2 * (p + 0.5) + 1) / ((p + (1 - p) + 0.5) + 2 + 1)
    assert float(crowd_loss(logits, crowd, known, dice_weight=0.5)) == pytest.approx(
        by_hand + 0.5 * (1 - dice), rel=1e-5
    )


@pytest.mark.parametrize("seasons", [False, True])
def test_augmentation_keeps_range_and_place(seasons: bool):
    rng = np.random.default_rng(5)
    image = torch.zeros(16, 3, 64, 64)
    image[:, :, 16:48, 16:48] = 0.8
    for _ in range(5):
        changed = varied(image.clone(), rng, seasons=seasons)
        assert changed.shape == image.shape
        assert float(changed.min()) >= 0.0 and float(changed.max()) <= 1.0
        contrast = changed[:, :, 20:44, 20:44].mean(dim=(1, 2, 3)) - changed[:, :, :, :12].mean(dim=(1, 2, 3))
        assert (contrast > 0).float().mean() > 0.9  # the square is still the bright part


def test_one_colour_of_a_picture_becomes_another():
    """Pale red beside pale blue beside grey: hues 120 degrees apart, of which at most one turns."""
    colours = torch.tensor([[0.5, 0.35, 0.35], [0.35, 0.35, 0.5], [0.4, 0.4, 0.4]])
    stripes = colours.T[:, None, :].repeat_interleave(8, dim=2).repeat(1, 6, 1)
    rng, changes = np.random.default_rng(3), []
    for _ in range(200):
        (picture,) = recoloured(stripes[None].clone(), rng)
        change = (picture - stripes).abs().amax(dim=(0, 1))[::8]
        assert change[2] < 1e-6
        torch.testing.assert_close(picture.mean(dim=0), stripes.mean(dim=0), atol=1e-6, rtol=0.0)
        # exp(-(2 pi / 3 / .9)^2) of any turn and of twice the strength is less than .01.
        assert change[:2].min() < 0.01
        changes.append(change[:2].max() > 0.05)
    # Two in five, few of which turn by little: the hue of grey counts as 0, which is 30 degrees from red.
    assert 0.25 < np.mean(changes) < 0.45


def test_augmentation_shows_softer_and_sharper_pictures():
    rng = np.random.default_rng(6)
    image = torch.from_numpy(rng.random((90, 3, 48, 48), np.float32))
    soft = torch.nn.functional.avg_pool2d(image, 3, 1, 1)  # so that there is something to sharpen

    def contrast(pictures: torch.Tensor) -> torch.Tensor:
        return (pictures[:, :, 8:40, 9:40] - pictures[:, :, 8:40, 8:39]).std(dim=(1, 2, 3))

    change = contrast(_focused(soft.clone(), rng)) / contrast(soft)
    sharper, softer = (change > 1.02).float().mean(), (change < 0.98).float().mean()
    assert 0.2 < float(sharper) < 0.45 and 0.2 < float(softer) < 0.45  # a third each
    assert float(change.min()) > 0.1 and float(change.max()) < 3.0


def test_clutter_comes_from_crops_without_crowd_and_covers_nobody():
    """A dark crop with a crowd in one corner beside a bright one without: only the dark one gets brighter,
    and never within 2 cells of people."""
    crowd = torch.zeros(2, 1, 24, 32)
    crowd[0, 0, 4:8, 4:8] = 1.0
    image = torch.stack([torch.full((3, 96, 128), 0.1), torch.full((3, 96, 128), 0.9)])
    batch = Batch(image, crowd, torch.ones_like(crowd))
    rng, reached = np.random.default_rng(7), torch.zeros(96, 128)
    for _ in range(60):
        mixed = cluttered(batch, free_of_people(batch), rng)
        assert torch.equal(mixed[1], image[1])  # the only other crop has a crowd, which must not be copied
        # Cells 2 to 9 are people's or within 2 of them: pixels 8 to 39. Cells next to them fade in.
        assert torch.allclose(mixed[0, :, 10:38, 10:38], image[0, :, 10:38, 10:38], atol=1e-6)
        reached = torch.maximum(reached, mixed[0].mean(dim=0))
    away = torch.ones(96, 128, dtype=torch.bool)
    away[4:44, 4:44] = False
    assert (reached[away] > 0.5).all()


def test_what_is_laid_over_crops_covers_nobody_and_three_to_five_in_ten_crops():
    crowd = torch.zeros(2, 1, 24, 32)
    crowd[:, 0, 4:8, 4:8] = 1.0
    batch = Batch(torch.full((2, 3, 96, 128), 0.5), crowd, torch.ones_like(crowd))
    rng, changed = np.random.default_rng(10), 0
    for _ in range(100):
        image = furnished(batch, free_of_people(batch), rng)
        assert float(image.min()) >= 0.0 and float(image.max()) <= 1.0
        assert torch.allclose(image[:, :, 10:38, 10:38], batch.image[:, :, 10:38, 10:38], atol=1e-6)
        changed += int((image != batch.image).flatten(1).any(dim=1).sum())
    # 1 - 0.7 x 0.8 = 0.44 of 200, less where what is laid falls beside the crop or on people.
    assert 50 < changed < 105


def test_foliage_has_the_colours_of_plants():
    """Yellow to red and green: where no plant is in flower, the largest of the three is never blue."""
    rng, like = np.random.default_rng(11), torch.zeros(3, 96, 128)
    blue = total = 0
    for _ in range(60):
        leaves, cover = crowns(rng, like)
        assert leaves.shape == (3, 96, 128) and cover.shape == (1, 96, 128)
        assert float(cover.min()) >= 0.0 and float(cover.max()) <= 1.0
        shown = (cover[0] > 0.5) & (leaves.amax(dim=0) > 0.1)
        blue += int((shown & (leaves[2] > leaves[:2].amax(dim=0) + 0.03)).sum())
        total += int(shown.sum())
    assert total > 50_000 and blue < 0.05 * total  # flowers: a third of the leaves of a seventh of the plants


def test_things_in_rows_show_where_they_cover_and_nowhere_else():
    rng, like = np.random.default_rng(12), torch.zeros(3, 96, 128)
    covered = 0.0
    for _ in range(60):
        laid, cover = panels(rng, like)
        assert float(laid.min()) >= 0.0 and float(laid.max()) <= 1.0
        assert float(cover.min()) >= 0.0 and float(cover.max()) <= 1.0
        assert (laid[:, cover[0] == 0.0] == 0.0).all()
        covered += float(cover.mean()) / 60
    assert 0.1 < covered < 0.9


def test_clutter_lies_on_no_unknown_cell():
    known = torch.ones(2, 1, 24, 32)
    known[0, :, :, 16:] = 0.0
    image = torch.stack([torch.full((3, 96, 128), 0.1), torch.full((3, 96, 128), 0.9)])
    rng = np.random.default_rng(8)
    for _ in range(30):
        batch = Batch(image, torch.zeros(2, 1, 24, 32), known)
        mixed = cluttered(batch, free_of_people(batch), rng)
        assert torch.allclose(mixed[0, :, :, 66:], image[0, :, :, 66:], atol=1e-6)


def test_a_camera_keeps_range_shape_and_place():
    rng = np.random.default_rng(9)
    image = torch.full((16, 3, 64, 64), 0.15)
    image[:, :, 16:48, 16:48] = 0.7
    changed = photographed(image.clone(), rng)
    assert changed.shape == image.shape
    assert float(changed.min()) >= 0.0 and float(changed.max()) <= 1.0
    inside = changed[:, :, 20:44, 20:44].mean(dim=(1, 2, 3))
    assert ((inside - changed[:, :, :, :10].mean(dim=(1, 2, 3))) > 0.05).all()
    untouched = (changed == image).flatten(1).all(dim=1)
    assert 2 <= int(untouched.sum()) <= 12  # four in ten on average


def test_a_gaussian_of_one_pixel_spreads_a_point_as_it_should():
    """exp(-1/2) / (1 + 2 (exp(-1/2) + exp(-2) + exp(-9/2) + exp(-8))) = .24197 one pixel away on a line."""
    line = torch.zeros(1, 1, 1, 21)
    line[..., 10] = 1.0
    soft = _softened(line.expand(1, 3, 21, 21), 1.0)
    assert soft[0, 0, 5, 11].item() == pytest.approx(0.24197, abs=2e-4)
    assert soft[0, 0].sum(dim=1).allclose(torch.ones(21), atol=1e-5)


def test_swapped_amplitudes_bring_the_light_of_one_picture_to_the_things_of_another(
    monkeypatch: pytest.MonkeyPatch,
):
    """Every image takes the mean, which is the amplitude of frequency 0, of the one that gives."""
    monkeypatch.setattr("crowdfence.detector_training.photography._SWAPPED", 1.1)
    rng = np.random.default_rng(10)
    stripes = 0.05 * torch.sin(torch.arange(64.0) * math.pi / 2)  # far above the frequencies that are swapped
    image = torch.stack([level + stripes.expand(3, 64, 64) for level in (0.2, 0.5, 0.8)])
    mixed = with_swapped_amplitudes(image, rng)
    levels = mixed.mean(dim=(1, 2, 3))
    assert all(min(abs(level - of) for of in (0.2, 0.5, 0.8)) < 1e-4 for level in levels.tolist())
    assert not torch.allclose(levels, image.mean(dim=(1, 2, 3)))
    assert torch.allclose(mixed - levels[:, None, None, None], stripes.expand(3, 3, 64, 64), atol=1e-4)


def test_wide_crops_show_things_at_more_scales_and_without_alias():
    """A fine checkerboard seen from far is grey, not the coarse pattern that skipped pixels make."""
    board = np.indices((96, 128)).sum(axis=0) % 2 * 255
    images = np.broadcast_to(board[None, :, :, None], (2, 96, 128, 3)).astype(np.uint8).copy()
    labels = np.zeros((2, 1, 48, 64), np.uint8)
    frames = StoredMission("board", images, labels, np.ones(labels.shape, np.bool_), ())
    plan = CropPlan(height=16, width=32, rotation_deg=0.0, wide=1.0, wide_scale=(2.5, 3.0))
    crops = CropSampler([frames], plan, CPU).draw(2, np.random.default_rng(11))
    assert float((crops.image - 0.5).abs().max()) < 0.12
    mixed = replace(plan, wide=0.3, scale=(1.0, 1.2))
    sampler, rng = CropSampler([frames], mixed, CPU), np.random.default_rng(12)
    scales = np.array([sampler._scale(96, 128, rng) for _ in range(1000)])
    assert 0.25 < (scales > 2.0).mean() < 0.35
    # No crop shows more than the frame.
    short = np.array([sampler._scale(42, 128, rng) for _ in range(1000)])
    assert short.max() <= 42 / 16


def mission(count: int, side: int, grey: int, photographs: bool = False) -> StoredMission:
    """Frames of one grey without anybody."""
    images = np.full((count, side, side, 3), grey, np.uint8)
    labels = np.zeros((count, 1, side // 2, side // 2), np.uint8)
    return StoredMission("", images, labels, np.ones(labels.shape, np.bool_), (), photographs)


def test_frames_are_drawn_as_often_as_their_pixels_say():
    """Two pictures of 3 x the side have 18 of the 28 shares of ten small ones and themselves."""
    plan = CropPlan(height=16, width=16, rotation_deg=0.0, scale=(1.0, 1.0))
    sampler = CropSampler([mission(10, 32, 0), mission(2, 96, 255)], plan, CPU)
    rng = np.random.default_rng(13)
    light = [float(sampler.draw(1, rng).image.mean()) for _ in range(600)]
    assert np.mean(light) == pytest.approx(18 / 28, abs=0.06)


@pytest.mark.parametrize(
    ("rendered", "photographs", "share"),
    [(97, 3, 0.1), (80, 20, 0.2), (0, 5, 1.0)],  # lifted; already more; nothing else
)
def test_photographs_keep_a_share_of_the_crops(rendered: int, photographs: int, share: float):
    plan = CropPlan(height=16, width=16, rotation_deg=0.0, scale=(1.0, 1.0), photographs=0.1)
    groups = [
        mission(count, 32, grey, grey > 0) for count, grey in ((rendered, 0), (photographs, 255)) if count
    ]
    sampler, rng = CropSampler(groups, plan, CPU), np.random.default_rng(14)
    light = [float(sampler.draw(1, rng).image.mean()) for _ in range(1000)]
    assert np.mean(light) == pytest.approx(share, abs=0.04)


def test_training_learns_and_a_resumed_training_is_the_same(tmp_path: Path):
    missions, held_out = [squares(1), squares(2)], [squares(3)]
    whole = train(missions, held_out, PLAN)
    assert whole.best.score.mean_iou > 0.6
    assert whole.history[-1].loss < whole.history[0].loss

    class Interrupted(Exception):
        pass

    def interrupt(step: int) -> None:
        if step == 120:  # after the checkpoint of step 100
            raise Interrupted

    checkpoint = tmp_path / "checkpoint"
    with pytest.raises(Interrupted):
        train(missions, held_out, PLAN, checkpoint=checkpoint, on_step=interrupt)
    resumed = train(missions, held_out, PLAN, checkpoint=checkpoint, resume=True)
    assert [one.step for one in resumed.history] == [50, 100, 150]
    for name, value in whole.network.state_dict().items():
        assert torch.equal(value, resumed.network.state_dict()[name]), name


@pytest.mark.parametrize("killed", [False, True])
def test_what_is_interrupted_before_its_first_validation_is_not_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, killed: bool
):
    """With 500 steps between validations, minutes of work were."""
    whole, checkpoint = train([squares(1)], [squares(2)], PLAN), tmp_path / "checkpoint"

    class Killed(Exception):
        pass

    def interrupt(step: int) -> None:
        if step == 10:
            if killed:
                raise Killed
            signal.raise_signal(signal.SIGINT)

    if killed:
        monkeypatch.setattr("crowdfence.detector_training.trainer._SAVED_EVERY_S", 0.0)
    with pytest.raises(Killed if killed else KeyboardInterrupt):
        train([squares(1)], [squares(2)], PLAN, checkpoint=checkpoint, on_step=interrupt)
    with pytest.raises(ValueError, match="a training that was not validated yet: go on with it"):
        train([squares(1)], [squares(2)], PLAN, initial=checkpoint)
    first: list[int] = []
    resumed = train(
        [squares(1)], [squares(2)], PLAN, checkpoint=checkpoint, resume=True, on_step=first.append
    )
    assert first[0] == (10 if killed else 11)
    assert [one.loss for one in resumed.history] == [one.loss for one in whole.history]
    for name, value in whole.network.state_dict().items():
        assert torch.equal(value, resumed.network.state_dict()[name]), name


def test_a_short_training_reaches_its_rate():
    """With 200 steps of warm-up, one of 100 ended at half of it."""
    plan = TrainingPlan(steps=100, learning_rate=1e-3)
    rates = [plan.learning_rate_at(step) for step in range(100)]
    assert max(rates) == pytest.approx(1e-3) and np.argmax(rates) == 24
    assert rates[0] == pytest.approx(1e-3 / 25) and rates[-1] < 2e-5
    assert TrainingPlan(steps=1).learning_rate_at(0) > 0.0
    assert TrainingPlan().learning_rate_at(99) == pytest.approx(0.5 * TrainingPlan().learning_rate)


def test_a_teacher_is_believed_by_the_share_that_it_has(tmp_path: Path):
    """One that says .5 everywhere: labels of 1 and 0 have the least loss at .3 + .7 x .5 = .65 and .35."""
    checkpoint = tmp_path / "teacher.checkpoint"
    plan = replace(PLAN, steps=2, validate_every=2, width=0.5)
    train([squares(1)], [squares(3)], plan, checkpoint=checkpoint)
    state = torch.load(checkpoint, weights_only=True)
    state["best"]["logit.weight"].zero_()
    state["best"]["logit.bias"].zero_()
    torch.save(state, checkpoint)
    held_out = squares(3)
    taught = train([squares(1), squares(2)], [held_out], replace(PLAN, dice_weight=0.0), teacher=checkpoint)
    with torch.no_grad():
        image = torch.from_numpy(held_out.images).permute(0, 3, 1, 2).float() / 255.0
        probability = torch.sigmoid(taught.network.cpu()(image))
    crowd = torch.nn.functional.avg_pool2d(torch.from_numpy(held_out.crowd).float() / 255.0, 2)
    inner = torch.nn.functional.avg_pool2d(crowd, 3, 1, 1)
    assert probability[inner == 1.0].median() == pytest.approx(0.65, abs=0.06)
    assert probability[inner == 0.0].median() == pytest.approx(0.35, abs=0.06)


def test_a_teacher_of_other_targets_is_refused_and_no_resumed_training_gets_another(tmp_path: Path):
    plan = replace(PLAN, steps=2, validate_every=2)
    one, other = tmp_path / "one.checkpoint", tmp_path / "other.checkpoint"
    train([squares(1)], [squares(3)], plan, checkpoint=one)
    train([squares(1)], [squares(3)], replace(plan, seed=1), checkpoint=other)
    taught = {"checkpoint": tmp_path / "taught.checkpoint", "resume": True}
    train([squares(1)], [squares(3)], plan, teacher=one, **taught)
    again = train([squares(1)], [squares(3)], plan, teacher=one, **taught)
    assert again.teacher == Teacher("one.checkpoint", 0.25, 2)
    told = training_facts(again, plan, [squares(1)], [squares(3)])["teacher"]
    assert told == {"checkpoint": "one.checkpoint", "width": 0.25, "steps": 2, "share": 0.7}
    for teacher in (other, None):
        with pytest.raises(ValueError, match="another training: teacher differ"):
            train([squares(1)], [squares(3)], plan, teacher=teacher, **taught)
    with pytest.raises(ValueError, match="was trained with targets"):
        train([squares(1)], [squares(3)], replace(plan, targets=("ground",)), teacher=one)


def test_weights_that_dice_made_too_sure_are_not_kept(monkeypatch: pytest.MonkeyPatch):
    """Dice ends after step 15: of the scores 0.9 at step 10, 0.5 at 20 and 0.4 at 30 the last is kept."""
    scores = iter((9, 5, 4))

    def scripted(*_: object) -> ValidationScore:
        hits = next(scores)
        return ValidationScore(0.1, {"silhouettes": Confusion(hits, 10 - hits, 90, 0)})

    monkeypatch.setattr("crowdfence.detector_training.trainer.validate", scripted)
    plan = replace(PLAN, steps=30, validate_every=10, calm_share=0.5)
    trained = train([squares(1)], [squares(3)], plan)
    assert [one.score.iou("silhouettes") for one in trained.history] == [0.9, 0.5, 0.4]
    assert trained.best.step == 30


def test_a_checkpoint_of_another_plan_is_refused(tmp_path: Path):
    checkpoint = tmp_path / "checkpoint"
    train([squares(1)], [squares(2)], replace(PLAN, steps=2, validate_every=2), checkpoint=checkpoint)
    with pytest.raises(ValueError, match="another training: steps"):
        train(
            [squares(1)],
            [squares(2)],
            replace(PLAN, steps=3, validate_every=2),
            checkpoint=checkpoint,
            resume=True,
        )


def test_a_checkpoint_of_other_missions_or_another_start_is_refused(tmp_path: Path):
    """The report named the new missions, and the model had learned the old ones."""
    checkpoint, plan = tmp_path / "checkpoint", replace(PLAN, steps=2, validate_every=2)
    train([squares(1)], [squares(2)], plan, checkpoint=checkpoint)
    again = {"checkpoint": checkpoint, "resume": True}
    with pytest.raises(ValueError, match="another training: missions differ; remove it"):
        train([squares(4)], [squares(2)], plan, **again)
    with pytest.raises(ValueError, match="another training: validation missions differ"):
        train([squares(1)], [squares(4)], plan, **again)
    with pytest.raises(ValueError, match=r"another training: start \(--initial\) differ"):
        train([squares(1)], [squares(2)], plan, initial=checkpoint, **again)
    assert train([squares(1)], [squares(2)], plan, **again).best.step == 2


@pytest.mark.parametrize("content", [b"hello\n", b"", b"PK\x03\x04"])
def test_what_is_no_checkpoint_or_model_is_one_line(tmp_path: Path, content: bytes):
    checkpoint = tmp_path / "checkpoint"
    checkpoint.write_bytes(content)
    with pytest.raises(ValueError, match="no whole checkpoint of `crowdfence train`"):
        train([squares(1)], [squares(2)], PLAN, checkpoint=checkpoint, resume=True)
    with pytest.raises(ValueError, match="no whole checkpoint of `crowdfence train`"):
        train([squares(1)], [squares(2)], PLAN, initial=checkpoint)
    torch.save({"weights": 1}, checkpoint)
    with pytest.raises(ValueError, match="no whole checkpoint of `crowdfence train`"):
        train([squares(1)], [squares(2)], PLAN, initial=checkpoint)
    model = tmp_path / "model.onnx"
    model.write_bytes(b"hello\n")
    with pytest.raises(ValueError, match=r"model\.onnx is no ONNX file"):
        import_onnx(model, 1, 1.0)


def test_a_model_in_eight_bits_says_which_one_to_start_from():
    from crowdfence.detector.shipped import shipped_model

    with pytest.raises(ValueError, match="eight bits the one that it was made from"):
        import_onnx(shipped_model("crowdnet-s"), 1, 1.0)


def test_missions_without_a_crowd_are_refused():
    """Learned from, they say that there is none; to validate on, the first weights were kept and training
    stopped as if nothing had improved on them."""
    with pytest.raises(ValueError, match=r"the training missions show no crowd \(silhouettes\)"):
        train([mission(4, 96, 40)], [squares(2)], PLAN)
    with pytest.raises(ValueError, match=r"the validation missions show no crowd \(silhouettes\)"):
        train([squares(1), mission(4, 96, 40)], [mission(4, 96, 40)], PLAN)
    unknown = replace_known(squares(2), np.zeros_like(squares(2).known))
    with pytest.raises(ValueError, match="the validation missions show no crowd"):
        train([squares(1)], [unknown], PLAN)


def test_weights_that_are_no_numbers_are_no_model(monkeypatch: pytest.MonkeyPatch):
    """The last step of a rate too large: its loss was still a number, what it left was not."""
    score = ValidationScore(math.nan, {"silhouettes": Confusion(0, 9, 90, 0)})
    monkeypatch.setattr("crowdfence.detector_training.trainer.validate", lambda *_: score)
    with pytest.raises(ValueError, match="the validation loss is nan at step 2: use a smaller learning rate"):
        train([squares(1)], [squares(2)], replace(PLAN, steps=2, validate_every=2))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": math.inf}, "width is inf; it must be above 0 and finite"),
        ({"learning_rate": math.inf}, "learning_rate is inf"),
        ({"width": 0.03}, "width is 0.03; below 0.0625 a layer would have no channel"),
    ],
)
def test_a_plan_that_gives_no_network_is_refused(changes: dict[str, float], message: str):
    with pytest.raises(ValueError, match=message):
        replace(PLAN, **changes)


def test_a_training_can_start_from_another(tmp_path: Path):
    checkpoint = tmp_path / "checkpoint"
    earlier = train([squares(1)], [squares(2)], PLAN, checkpoint=checkpoint)
    told: list[Checkup] = []
    plan = replace(PLAN, steps=2, validate_every=1, learning_rate=1e-9)
    later = train([squares(1)], [squares(2)], plan, initial=checkpoint, on_checkup=told.append)
    assert later.start == told[0] and [one.step for one in later.history] == [0, 1, 2]
    assert later.start.score == earlier.best.score and later.start.loss is None and earlier.start is None
    assert later.history[1].score.mean_iou == pytest.approx(earlier.best.score.mean_iou, abs=0.02)
    with pytest.raises(ValueError, match="trained with width 0.25, this training has 0.5"):
        train([squares(1)], [squares(2)], replace(PLAN, width=0.5), initial=checkpoint)


def test_a_training_that_made_it_worse_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """The history began with step 500: nobody saw what it was before."""
    from crowdfence.cli.train import _warn_of_worse

    checkpoint, going_on = tmp_path / "checkpoint", tmp_path / "going-on"
    train([squares(1)], [squares(2)], PLAN, checkpoint=checkpoint)
    ruin = replace(PLAN, steps=6, validate_every=2, learning_rate=3.0, average_decay=0.0, patience=2)
    worse = train([squares(1)], [squares(2)], ruin, initial=checkpoint, checkpoint=going_on)
    assert worse.worse_than_start("silhouettes") and worse.best.step > 0  # what was trained is kept
    facts = training_facts(worse, ruin, [squares(1)], [squares(2)])
    assert facts["worse_than_start"] and facts["start"] == facts["history"][0]
    assert facts["start"]["step"] == 0 and facts["start"]["loss"] is None
    write_report(tmp_path / "report", worse, ruin, [squares(1)], [squares(2)])
    _warn_of_worse(worse, ruin, checkpoint)
    assert "is worse than" in capsys.readouterr().err
    again = train([squares(1)], [squares(2)], ruin, initial=checkpoint, checkpoint=going_on, resume=True)
    assert again.history == worse.history


def test_a_training_goes_on_from_a_model_with_statistics_of_its_own(tmp_path: Path):
    pytest.importorskip("onnxscript")
    from crowdfence.cli.train import _contract
    from crowdfence.detector_training.onnx_export import export_onnx

    earlier = train([squares(1)], [squares(2)], PLAN)
    model = tmp_path / "earlier.onnx"
    export_onnx(earlier.network, 0, _contract(model, PLAN, {"parameters": 1}, None), model)
    plan = replace(PLAN, steps=2, validate_every=1, learning_rate=1e-9, seasons=True)
    later = train([squares(1)], [squares(2)], plan, initial=model)
    for one in later.history:  # as it was, and with statistics measured
        assert one.score.mean_iou == pytest.approx(earlier.best.score.mean_iou, abs=0.02)
    frozen = train([squares(1)], [squares(2)], replace(plan, frozen_statistics=True), initial=model)
    means = [
        [one.running_mean.abs().max() for one in network.modules() if isinstance(one, torch.nn.BatchNorm2d)]
        for network in (later.network, frozen.network)
    ]
    assert min(means[0]) > 1e-3 and max(means[1]) == 0.0


def test_a_wide_training_learns_and_a_resumed_one_is_the_same(tmp_path: Path):
    plan = replace(
        PLAN, steps=60, validate_every=30, wide=True, crops=replace(PLAN.crops, wide=0.3, wide_scale=(0.5, 2))
    )
    crowded = squares(5)
    nobody = np.zeros_like(crowded.images), np.zeros_like(crowded.crowd)
    empty = StoredMission("nobody", *nobody, crowded.known, ())
    checkpoint = tmp_path / "checkpoint"
    whole = train([squares(1), empty], [squares(3)], plan, checkpoint=checkpoint)
    assert whole.history[-1].loss < whole.history[0].loss

    class Interrupted(Exception):
        pass

    def interrupt(step: int) -> None:
        if step == 40:
            raise Interrupted

    half = tmp_path / "half"
    with pytest.raises(Interrupted):
        train([squares(1), empty], [squares(3)], plan, checkpoint=half, on_step=interrupt)
    resumed = train([squares(1), empty], [squares(3)], plan, checkpoint=half, resume=True)
    for name, value in whole.network.state_dict().items():
        assert torch.equal(value, resumed.network.state_dict()[name]), name


def test_training_stops_when_validation_does_not_improve(tmp_path: Path):
    plan = replace(PLAN, steps=200, validate_every=2, patience=2, learning_rate=1e-9, calm_share=0.0)
    checkpoint = tmp_path / "checkpoint"
    stopped = train([squares(1)], [squares(2)], plan, checkpoint=checkpoint)
    assert stopped.stopped_early and stopped.history[-1].step < 200
    # Where its model could not be written, --resume writes that one and trains no further.
    again = train([squares(1)], [squares(2)], plan, checkpoint=checkpoint, resume=True)
    assert again.stopped_early and again.history == stopped.history


def test_a_copy_of_what_is_trained_on_is_no_validation():
    """Under another path it was taken for held out, and the best weights were those that knew it by heart."""
    copy = replace(squares(3), name="copy")
    with pytest.raises(ValueError, match="mission copy holds the frames of squares-3, which is trained on"):
        train([squares(1), squares(3)], [squares(2), copy], PLAN)


def test_training_without_validation_is_refused():
    with pytest.raises(ValueError, match="at least one validation mission"):
        train([squares(1)], [], PLAN)


def test_validation_counts_known_cells_by_hand():
    mission = squares(4, frames=1)
    known = mission.known.copy()
    known[:, :, :, :32] = False  # the left half: 16 of 32 columns of cells, two labels each
    half = replace_known(mission, known)
    network = CrowdNet(1, width=0.25)
    torch.nn.init.zeros_(network.logit.weight)
    torch.nn.init.constant_(network.logit.bias, 4.0)  # everything is crowd, it says
    score = validate(network, [half], ["silhouettes"], CPU)
    crowd = int((mission.crowd[:, :, ::2, 32::2] > 127).sum())  # squares are whole cells
    assert score.cells["silhouettes"].true_positives == crowd
    assert score.cells["silhouettes"].false_positives == 24 * 16 - crowd
    assert score.iou("silhouettes") == pytest.approx(crowd / (24 * 16))


def corner(side: int) -> StoredMission:
    """A bright square picture with crowd everywhere, in the corner of a canvas of 128 x 128 around which
    nothing is known, beside one that fills it."""
    images, crowd = np.zeros((2, 128, 128, 3), np.uint8), np.zeros((2, 1, 64, 64), np.uint8)
    known = np.zeros(crowd.shape, np.bool_)
    for frame, (own, grey) in enumerate(((side, 200), (128, 90))):
        images[frame, :own, :own] = grey
        crowd[frame, :, : own // 2, : own // 2] = 255
        known[frame, :, : own // 2, : own // 2] = True
    return StoredMission("corner", images, crowd, known, (), True, (), np.array([(side, side), (128, 128)]))


def test_crops_of_small_pictures_do_not_show_the_canvas_of_the_largest():
    """Drawn all over it, nearly all crops of a picture of 32 beside one of 128 held nothing to learn."""
    plan = CropPlan(height=16, width=16, scale=(1.0, 1.0), rotation_deg=0.0, on_crowd=0.0)
    sampler, rng, small = CropSampler([corner(32)], plan, CPU), np.random.default_rng(15), 0
    for _ in range(300):
        crop = sampler.draw(1, rng)
        assert crop.known.all() and crop.crowd.all()
        small += float(crop.image.mean()) > 0.5
    assert 5 < small < 40  # 1 of 17, as their pixels say


@pytest.mark.parametrize("side", [4, 12, 40])
def test_validation_sees_a_picture_as_a_detector_does(side: int):
    """Neither the black around it nor a cut, which is nothing for one of less than 16 pixels; the network
    counts what the mean of the whole picture says."""
    torch.manual_seed(0)
    network, pictures = CrowdNet(1, width=0.25).eval(), corner(side)
    whole = -side % 16
    image = np.pad(pictures.images[0, :side, :side], ((0, whole), (0, whole), (0, 0)), mode="edge")
    with torch.no_grad():
        alone = network(torch.from_numpy(image).permute(2, 0, 1)[None].float() / 255.0)
    torch.nn.init.constant_(network.logit.bias, float(network.logit.bias.detach() - alone[0, 0, 0, 0]) + 1e-3)
    score = validate(network, [pictures], ["ground"], CPU)
    with torch.no_grad():
        alone = network(torch.from_numpy(image).permute(2, 0, 1)[None].float() / 255.0)
        other = network(torch.from_numpy(pictures.images[1]).permute(2, 0, 1)[None].float() / 255.0)
    called = int((alone[0, 0, : side // 4, : side // 4] > 0).sum()) + int((other > 0).sum())
    cells = score.cells["ground"]
    assert cells.true_positives == called
    assert cells.true_positives + cells.false_negatives == (side // 4) ** 2 + 32**2


def replace_known(mission: StoredMission, known: np.ndarray) -> StoredMission:
    return StoredMission(mission.name, mission.images, mission.crowd, known, ())


def test_the_exported_model_is_the_network(tmp_path: Path):
    pytest.importorskip("onnxscript")
    import onnxruntime

    from crowdfence.cli.train import _contract
    from crowdfence.detector.contract.contract import Contract
    from crowdfence.detector_training.onnx_export import export_onnx

    torch.manual_seed(3)
    network = CrowdNet(2, width=0.5)
    for module in network.modules():  # statistics as after a training, not the neutral ones
        if isinstance(module, torch.nn.BatchNorm2d):
            module.running_mean.uniform_(-0.5, 0.5)
            module.running_var.uniform_(0.5, 2.0)
    network.eval()
    contract = _contract(tmp_path / "tiny.onnx", TrainingPlan(targets=("ground",)), {"parameters": 1}, None)
    export_onnx(network, 1, contract, tmp_path / "tiny.onnx")
    session = onnxruntime.InferenceSession(tmp_path / "tiny.onnx", providers=["CPUExecutionProvider"])
    stored = json.loads(session.get_modelmeta().custom_metadata_map["crowdfence"])
    assert Contract.from_json(stored) == contract
    rng = np.random.default_rng(0)
    for shape in ((1, 48, 64, 3), (3, 32, 80, 3)):  # batch and sides are free
        pictures = rng.integers(0, 256, shape, np.uint8)
        (heatmap,) = session.run(None, {"image": pictures})
        with torch.no_grad():
            pixels = torch.from_numpy(pictures).permute(0, 3, 1, 2).float() / 255.0
            expected = torch.sigmoid(network(pixels)[:, 1:2]).numpy()
        assert heatmap.dtype == np.float32
        np.testing.assert_allclose(heatmap, expected, atol=2e-6)


def test_an_exported_model_comes_back_as_the_network_it_was(tmp_path: Path):
    pytest.importorskip("onnxscript")
    from crowdfence.cli.train import _contract
    from crowdfence.detector_training.onnx_export import export_onnx

    torch.manual_seed(4)
    network = CrowdNet(2, width=0.5)
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.running_mean.uniform_(-0.5, 0.5)
            module.running_var.uniform_(0.5, 2.0)
            torch.nn.init.uniform_(module.weight, 0.5, 1.5)
    network.eval()
    model = tmp_path / "tiny.onnx"
    contract = _contract(model, TrainingPlan(targets=("silhouettes",)), {"parameters": 1}, None)
    export_onnx(network, 1, contract, model)

    back = CrowdNet(3, width=0.5)
    back.load_state_dict(import_onnx(model, 3, 0.5))
    pictures = torch.rand(2, 3, 48, 64)
    with torch.no_grad():
        expected = network(pictures)[:, 1:2].expand(-1, 3, -1, -1)
        torch.testing.assert_close(back.eval()(pictures), expected, atol=1e-4, rtol=0.0)
        back.train()
        freeze_statistics(back)
        torch.testing.assert_close(back(pictures), expected, atol=1e-4, rtol=0.0)
        # With statistics of these pictures it says the same of them, of others, and normalising them anew.
        back.eval()
        others = torch.rand(2, 3, 48, 64) ** 2
        of_others = back(others)
        measure_statistics(back, pictures)
        torch.testing.assert_close(back(others), of_others, atol=1e-4, rtol=0.0)
        torch.testing.assert_close(back.train()(pictures), expected, atol=1e-2, rtol=0.0)
    with pytest.raises(ValueError, match="of width 1"):
        import_onnx(model, 1, 1.0)


def test_the_shipped_model_can_be_trained_further():
    import onnxruntime

    from crowdfence.detector.shipped import shipped_model

    as_trained = shipped_model("crowdnet-s-float32")
    back = CrowdNet(1)
    back.load_state_dict(import_onnx(as_trained, 1, 1.0))
    pictures = np.random.default_rng(0).integers(0, 256, (1, 96, 128, 3), np.uint8)
    session = onnxruntime.InferenceSession(as_trained, providers=["CPUExecutionProvider"])
    stored = json.loads(session.get_modelmeta().custom_metadata_map["crowdfence"])
    (heatmap,) = session.run(None, {"image": pictures})
    in_graph = stored["calibration"]["in_graph"]
    with torch.no_grad():
        logits = back.eval()(torch.from_numpy(pictures).permute(0, 3, 1, 2).float() / 255.0)
    calibrated = torch.sigmoid(logits * in_graph["scale"] + in_graph["bias"]).numpy()
    np.testing.assert_allclose(calibrated, heatmap, atol=1e-4)
