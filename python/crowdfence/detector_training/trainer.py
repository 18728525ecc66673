"""The training loop: seeded, resumable, stopped when validation no longer improves."""

from __future__ import annotations

import hashlib
import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor

from crowdfence.atomic_file import atomic_path
from crowdfence.detector_training.augmentation import varied
from crowdfence.detector_training.average import WeightAverage
from crowdfence.detector_training.clutter import cluttered, free_of_people, furnished
from crowdfence.detector_training.crops import Batch, CropSampler
from crowdfence.detector_training.frame_store import StoredMission
from crowdfence.detector_training.labels import Target
from crowdfence.detector_training.loss import crowd_loss
from crowdfence.detector_training.network import CrowdNet
from crowdfence.detector_training.onnx_import import freeze_statistics, import_onnx, measure_statistics
from crowdfence.detector_training.photography import photographed
from crowdfence.detector_training.plan import TrainingPlan
from crowdfence.detector_training.resident_crops import ResidentCrops, crop_source
from crowdfence.detector_training.validation import ValidationScore, validate
from crowdfence.stop_request import StopRequest

TAUGHT = 0.7
"""Share of a teacher's answers in what is learned; the rest is labels."""
_MADE_AHEAD = 2
"""Batches that are made while one is learned, each by a thread: with `wide` a batch takes longer to make."""
_SAVED_EVERY_S = 60.0
"""Work that a killed training loses at most."""
_MEASURED = 96
"""Crops that tell the statistics of a model which has none."""
_MEASURED_AT = 1_000_000
"""Their step: none of a training's own."""


@dataclass(frozen=True, slots=True)
class Checkup:
    """One validation on the way."""

    step: int
    seconds: float
    """Time spent on training so far."""
    loss: float | None
    """Mean training loss since the last one; None of the weights that a training starts from."""
    score: ValidationScore


@dataclass(frozen=True, slots=True)
class Teacher:
    """What is told of a network whose answers are learned."""

    checkpoint: str
    width: float
    steps: int
    """Of its training so far."""
    share: float = TAUGHT


@dataclass(frozen=True, slots=True, eq=False)
class Trained:
    """What training ends with."""

    network: CrowdNet
    """The averaged weights of `best`."""
    best: Checkup
    history: list[Checkup]
    """Begins with step 0, the weights that it started from, where another training made them."""
    stopped_early: bool
    teacher: Teacher | None = None

    @property
    def start(self) -> Checkup | None:
        """Of the weights that it started from."""
        return self.history[0] if self.history[0].step == 0 else None

    def worse_than_start(self, target: Target) -> bool:
        """Whether the validation missions say that it would better not have been trained."""
        return self.start is not None and self.best.score.iou(target) < self.start.score.iou(target)


def train(
    missions: Sequence[StoredMission],
    validation: Sequence[StoredMission],
    plan: TrainingPlan,
    *,
    checkpoint: Path | None = None,
    resume: bool = False,
    initial: Path | None = None,
    teacher: Path | None = None,
    device: torch.device | None = None,
    on_step: Callable[[int], None] | None = None,
    on_checkup: Callable[[Checkup], None] | None = None,
) -> Trained:
    """Train a network on `missions`: its averaged weights at the end, or, when the mean IoU on `validation`
    no longer improves before the calm steps, the best until then.

    With `checkpoint` the state is written there at every validation, once a minute between them, and where
    SIGINT or SIGTERM end it (KeyboardInterrupt, after the step); `resume` goes on from it with the same plan
    and gives the very steps that an uninterrupted training would have taken. Equal seeds, missions and
    machines give equal weights. `initial` is the checkpoint of another training, or the model that it wrote,
    whose weights this one starts from; a model holds no statistics, so they are measured on crops unless the
    plan freezes them. `teacher` is the checkpoint of another training with the same targets, of a larger
    network as a rule, whose answers on the same crops this one learns beside the labels.

    ValueError for missions without frames or without a crowd, one in both places, a checkpoint of another
    plan, other missions or another start, weights of another network, or a loss that is not finite.
    """
    device = device or default_device()
    if not validation:
        raise ValueError("training needs at least one validation mission: keep one that is not trained on")
    sampler = crop_source(missions, plan.crops, device)
    if not len(sampler):
        raise ValueError("the training missions hold no usable frame")
    for what, some in (("training", missions), ("validation", validation)):
        _require_crowd(what, some, plan.targets)
    digests, held_out = _digests(missions), _digests(validation)
    for mission, digest in zip(validation, held_out, strict=True):
        if digest in digests:
            same = missions[digests.index(digest)].name
            raise ValueError(
                f"the validation mission {mission.name} holds the frames of {same}, which is trained on: it "
                "would vouch for itself; take another one"
            )
    run = _Run(plan, device, {"missions": digests, "validation missions": held_out})
    if initial is not None:
        run.start_from(initial)
    taught_by = None if teacher is None else run.learn_from(teacher)
    if resume and checkpoint is not None and checkpoint.exists():
        run.load(checkpoint)
    elif initial is not None:
        if initial.suffix == ".onnx" and not plan.frozen_statistics:
            run.measure(_crops(sampler, plan, _MEASURED_AT, _MEASURED).image)
        run.check_up(validation)
        if on_checkup is not None:
            on_checkup(run.history[-1])
    started = saved = time.monotonic()
    before = run.seconds
    stopped = run.stopped  # already, where it ended before its model was written
    with StopRequest() as stop:
        for step, batch in () if stopped else _batches(sampler, plan, run.step):
            run.advance(batch, step)
            run.seconds = before + time.monotonic() - started
            if on_step is not None:
                on_step(step)
            due = (step + 1) % plan.validate_every == 0 or step + 1 == plan.steps
            if due:
                run.check_up(validation)
            if checkpoint is not None and (due or stop.wanted or time.monotonic() - saved > _SAVED_EVERY_S):
                run.save(checkpoint)
                saved = time.monotonic()
            if due and on_checkup is not None:
                on_checkup(run.history[-1])
            if stop.wanted:
                raise KeyboardInterrupt
            stopped = run.stopped
            if stopped:
                break
    run.average.network.load_state_dict(run.best_state)
    return Trained(run.average.network, run.best, run.history, stopped, taught_by)


def initial_weights(path: Path, plan: TrainingPlan, device: torch.device | None = None) -> dict[str, Tensor]:
    """The best weights of another training, from its checkpoint or from the model that it wrote. ValueError
    where a training of this plan cannot start from them."""
    if path.suffix == ".onnx":
        return import_onnx(path, len(plan.targets), plan.width)
    state = _state_like(path, plan, ("targets", "width", "vibrance"), device or default_device())
    return cast(dict[str, Tensor], state["best"])


def teacher_of(path: Path, plan: TrainingPlan) -> Teacher:
    """What there is to tell of a teacher. ValueError where a training of this plan cannot learn from it."""
    return _teacher(path, plan, torch.device("cpu"))[0]


def _teacher(path: Path, plan: TrainingPlan, device: torch.device) -> tuple[Teacher, dict[str, Tensor]]:
    """With its best weights."""
    if path.suffix == ".onnx":
        raise ValueError(
            f"{path} is a model; a teacher is the checkpoint that its training left beside it, "
            f"{path.with_suffix('.checkpoint').name}"
        )
    state = _state_like(path, plan, ("targets", "vibrance"), device)
    return Teacher(path.name, state["plan"]["width"], state["step"]), state["best"]


def _require_crowd(what: str, missions: Sequence[StoredMission], targets: Sequence[Target]) -> None:
    """ValueError where no frame shows a crowd: a network would learn that there is none, and no IoU could
    tell which weights are better."""
    for plane, target in enumerate(targets):
        if not any(
            bool(((crowd[plane] > 127) & known[plane]).any())
            for mission in missions
            for crowd, known in zip(mission.crowd, mission.known, strict=True)
        ):
            raise ValueError(
                f"the {what} missions show no crowd ({target}) in any of their frames: add some that "
                "do; are all classes of people named?"
            )


def _digests(missions: Sequence[StoredMission]) -> list[str]:
    """Of the labels of each and every 16th pixel along each axis."""
    digests = []
    for mission in missions:
        digest = hashlib.sha256(str(mission.images.shape).encode())
        for frame in range(len(mission)):
            for values in (mission.crowd[frame], mission.known[frame], mission.images[frame, ::16, ::16]):
                digest.update(np.ascontiguousarray(values).tobytes())
        digests.append(digest.hexdigest())
    return digests


def default_device() -> torch.device:
    """A GPU where there is one."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def _batches(
    sampler: CropSampler | ResidentCrops, plan: TrainingPlan, first: int
) -> Iterator[tuple[int, Batch]]:
    """Batches of the steps from `first` on, the next ones made while the last is learned. The random numbers
    of a step depend on nothing but seed and step: that is what makes a resumed training the same."""

    def made(step: int) -> Batch:
        return _crops(sampler, plan, step, plan.batch)

    steps = iter(range(first, plan.steps))
    with ThreadPoolExecutor(_MADE_AHEAD) as pool:
        coming = deque((step, pool.submit(made, step)) for step in islice(steps, _MADE_AHEAD))
        while coming:
            step, batch = coming.popleft()
            coming.extend((later, pool.submit(made, later)) for later in islice(steps, 1))
            yield step, batch.result()


def _crops(sampler: CropSampler | ResidentCrops, plan: TrainingPlan, step: int, count: int) -> Batch:
    rng = np.random.default_rng([plan.seed, step])
    batch = sampler.draw(count, rng)
    if not plan.wide:
        return batch._replace(image=varied(batch.image, rng, seasons=plan.seasons))
    free = free_of_people(batch)
    batch = batch._replace(image=cluttered(batch, free, rng))
    image = varied(furnished(batch, free, rng), rng, seasons=plan.seasons)
    return batch._replace(image=photographed(image, rng))


class _Run:
    """The state of a training between two steps."""

    def __init__(self, plan: TrainingPlan, device: torch.device, data: dict[str, list[str]]) -> None:
        torch.manual_seed(plan.seed)
        self._plan, self._device = plan, device
        self._origin: dict[str, Any] = {**data, "start (--initial)": None}
        """What a checkpoint must have begun with, besides the plan, for this training to go on with it."""
        # Pixels with their channels side by side: faster convolutions on CPUs and on GPUs.
        self.network = CrowdNet(len(plan.targets), width=plan.width).to(
            device,
            memory_format=torch.channels_last,  # type: ignore[call-overload]
        )
        self.average = WeightAverage(self.network, plan.average_decay)
        self._optimiser = torch.optim.AdamW(
            self.network.parameters(), plan.learning_rate, weight_decay=plan.weight_decay
        )
        self._teacher: CrowdNet | None = None
        self.step = 0
        self.seconds = 0.0
        """Spent on training so far."""
        self.losses: list[torch.Tensor] = []
        """Of the steps since the last validation."""
        self.history: list[Checkup] = []
        self.best_state: dict[str, Any] = {}

    def start_from(self, path: Path) -> None:
        """The best weights of another training, from its checkpoint or from the model that it wrote."""
        self._take(initial_weights(path, self._plan, self._device))

    def _take(self, weights: dict[str, torch.Tensor]) -> None:
        self.network.load_state_dict(weights)
        self.average.network.load_state_dict(weights)
        self._origin["start (--initial)"] = _digest(weights)

    def learn_from(self, path: Path) -> Teacher:
        """The best weights of another training, which tell this one what they see."""
        told, weights = _teacher(path, self._plan, self._device)
        teacher = CrowdNet(len(self._plan.targets), width=told.width).to(
            self._device,
            memory_format=torch.channels_last,  # type: ignore[call-overload]
        )
        teacher.load_state_dict(weights)
        self._teacher = teacher.eval().requires_grad_(False)
        self._origin["teacher"] = _digest(weights)
        return told

    def measure(self, images: torch.Tensor) -> None:
        """Take the statistics of these images; nothing that the network says changes."""
        measure_statistics(self.network, images)
        self.average.network.load_state_dict(self.network.state_dict())

    @property
    def best(self) -> Checkup:
        """The validation with the largest IoU, the start left out; once the calm steps have begun, the last
        one: averaged weights need time to lose the certainty that Dice gave them, which the IoU does not
        show."""
        if self.history[-1].step > self._plan.calm_from:
            return self.history[-1]
        return max(self._judged, key=lambda one: one.score.mean_iou)

    @property
    def _judged(self) -> list[Checkup]:
        """Without the start: at full rate a training is worse than that for a while."""
        return [one for one in self.history if one.step > 0]

    @property
    def waited(self) -> int:
        """Validations since the best one. The calm steps at the end are always taken whole."""
        if self.step > self._plan.calm_from:
            return 0
        return len(self._judged) - 1 - self._judged.index(self.best)

    @property
    def stopped(self) -> bool:
        """Whether validation has not improved for too long."""
        return bool(self._judged) and self.waited >= self._plan.patience

    def advance(self, batch: Batch, step: int) -> None:
        """One step."""
        self.network.train()
        if self._plan.frozen_statistics:
            freeze_statistics(self.network)
        for group in self._optimiser.param_groups:
            group["lr"] = self._plan.learning_rate_at(step)
        image = batch.image.contiguous(memory_format=torch.channels_last)
        with torch.autocast(self._device.type, torch.bfloat16, enabled=_computes_bfloat16(self._device)):
            logits = self.network(image)
            told = None if self._teacher is None else self._teacher(image)
        dice = 0.0 if step >= self._plan.calm_from else self._plan.dice_weight
        loss = crowd_loss(logits.float(), batch.crowd, batch.known, dice_weight=dice)
        if told is not None:
            of_teacher = crowd_loss(
                logits.float(), torch.sigmoid(told.float()), batch.known, dice_weight=dice
            )
            loss = torch.lerp(loss, of_teacher, TAUGHT)
        self._optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 5.0)
        self._optimiser.step()
        self.average.update(self.network, step)
        self.step = step + 1
        self.losses.append(loss.detach())

    def check_up(self, validation: Sequence[StoredMission]) -> None:
        """Validate. ValueError for a loss that is not finite."""
        mean_loss = float(torch.stack(self.losses).mean()) if self.losses else None
        self.losses.clear()
        if mean_loss is not None and not math.isfinite(mean_loss):
            raise ValueError(f"the loss is {mean_loss} at step {self.step}: use a smaller learning rate")
        score = validate(self.average.network, validation, self._plan.targets, self._device)
        if not math.isfinite(score.loss):
            advice = "use a smaller learning rate" if self.step else "start from other weights (--initial)"
            raise ValueError(f"the validation loss is {score.loss} at step {self.step}: {advice}")
        checkup = Checkup(self.step, self.seconds, mean_loss, score)
        self.history.append(checkup)
        if not self._judged or self.best is checkup:
            self.best_state = {
                name: value.clone() for name, value in self.average.network.state_dict().items()
            }

    def save(self, path: Path) -> None:
        state = {
            "plan": asdict(self._plan),
            "origin": self._origin,
            "step": self.step,
            "seconds": self.seconds,
            "losses": [float(one) for one in self.losses],
            "network": self.network.state_dict(),
            "average": self.average.network.state_dict(),
            "best": self.best_state,
            "optimiser": self._optimiser.state_dict(),
            "history": [asdict(one) for one in self.history],
        }
        with atomic_path(path) as part, part.open("wb") as file:
            torch.save(state, file)

    def load(self, path: Path) -> None:
        state = _loaded(path, self._device)
        plan, origin = asdict(self._plan), state.get("origin", self._origin)  # older ones say nothing of it
        if (state["plan"], origin) != (plan, self._origin):
            differs = [name for name, value in plan.items() if state["plan"].get(name) != value]
            began = sorted(self._origin.keys() | origin.keys())
            differs += [name for name in began if origin.get(name) != self._origin.get(name)]
            raise ValueError(
                f"{path} belongs to another training: {', '.join(differs)} differ; remove it to start anew"
            )
        self.step = state["step"]
        self.network.load_state_dict(state["network"])
        self.average.network.load_state_dict(state["average"])
        self.best_state = state["best"]
        self._optimiser.load_state_dict(state["optimiser"])
        self.losses = [torch.tensor(one, device=self._device) for one in state.get("losses", ())]
        self.history = [_checkup_of_data(one) for one in state["history"]]
        self.seconds = state.get("seconds", self.history[-1].seconds if self.history else 0.0)


def _digest(weights: dict[str, torch.Tensor]) -> str:
    digest = hashlib.sha256()
    for value in weights.values():
        digest.update(value.cpu().numpy().tobytes())
    return digest.hexdigest()


def _state_like(path: Path, plan: TrainingPlan, names: Sequence[str], device: torch.device) -> dict[str, Any]:
    """A checkpoint whose plan agrees with this one in `names`, with weights that were validated."""
    state = _loaded(path, device)
    for name in names:
        of_that, of_this = state["plan"][name], getattr(plan, name)
        if of_that != of_this:
            raise ValueError(f"{path} was trained with {name} {of_that}, this training has {of_this}")
    if not state["best"]:
        raise ValueError(
            f"{path} is of a training that was not validated yet: go on with it (--resume) first"
        )
    return state


def _loaded(path: Path, device: torch.device) -> dict[str, Any]:
    """The state in a checkpoint. ValueError for another file, whatever PyTorch takes it for."""
    try:
        state = torch.load(path, map_location=device, weights_only=True)
    except OSError:
        raise
    except Exception:
        state = None
    if (
        not isinstance(state, dict)
        or not {"plan", "step", "network", "average", "best", "history"} <= state.keys()
    ):
        raise ValueError(f"{path} is no whole checkpoint of `crowdfence train`: name another, or remove it")
    state["plan"] = {"vibrance": 1.0, **state["plan"]}  # older ones say nothing of it
    return state


def _computes_bfloat16(device: torch.device) -> bool:
    """Whether half the bits make it faster here."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported()
    return bool(torch.cpu._is_avx512_bf16_supported())


def _checkup_of_data(data: dict[str, Any]) -> Checkup:
    from crowdfence.evaluation.cells.rates import Confusion

    score = data["score"]
    cells = {target: Confusion(**counts) for target, counts in score["cells"].items()}
    return Checkup(data["step"], data["seconds"], data["loss"], ValidationScore(score["loss"], cells))
