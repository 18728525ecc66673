"""`crowdfence train`: labelled missions -> an ONNX detector with its report."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crowdfence.atomic_file import replaceable_file, require_replaceable, writable_folder
from crowdfence.cli import console, options
from crowdfence.cli.exit_codes import INTERRUPTED
from crowdfence.cli.wording import counted

if TYPE_CHECKING:
    from crowdfence.detector.contract.contract import Contract
    from crowdfence.detector_training.frame_store import StoredMission
    from crowdfence.detector_training.plan import TrainingPlan
    from crowdfence.detector_training.trainer import Checkup, Trained

SEASONS_SCALE = (0.4, 1.5)
"""Pixels of the frame per pixel of the crop with `--seasons`: far ground is looked at twice as large."""
WIDE_CROPS = 0.3
"""Share of the crops of any scale with `--wide`."""
WIDE_PHOTOGRAPHS = 0.1
"""Least share of the crops from labelled pictures with `--wide`, where there are some."""


def train(
    data: Annotated[
        list[Path], typer.Option("--data", help="Labelled mission to train on, or a folder of them; repeat.")
    ],
    validation: Annotated[
        list[Path],
        typer.Option("--validation", help="Mission, or folder of them, that decides when to stop; repeat."),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Model to write (.onnx).")],
    target: Annotated[
        list[options.LabelTarget] | None,
        typer.Option(
            "--target",
            help="Mark the ground under crowds or their silhouettes. Repeat to train both; the model holds "
            "the first. Default: ground.",
        ),
    ] = None,
    steps: Annotated[int | None, typer.Option("--steps", help="Steps in all.")] = None,
    batch: Annotated[int | None, typer.Option("--batch", help="Crops per step.")] = None,
    width: Annotated[float | None, typer.Option("--width", help="Scale of the channel counts.")] = None,
    learning_rate: Annotated[
        float | None, typer.Option("--learning-rate", help="Largest learning rate.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed of weights and crops.")] = 0,
    store: Annotated[
        Path | None, typer.Option("--store", help="Folder for decoded frames. Default: beside the model.")
    ] = None,
    workers: Annotated[
        int, typer.Option("--workers", min=1, max=256, help="Processes that decode missions.")
    ] = 2,
    initial: Annotated[
        Path | None,
        typer.Option(
            "--initial",
            help="Checkpoint, or model, of an earlier training to start from. What a model says of sizes, "
            "colours and licence is said of the new one too.",
        ),
    ] = None,
    live_statistics: Annotated[
        bool,
        typer.Option(
            "--live-statistics",
            help="From a model: batch normalisation follows the crops again, for a long training at full "
            "rate. Default: it stays as it is.",
        ),
    ] = False,
    teacher: Annotated[
        Path | None,
        typer.Option(
            "--teacher",
            help="Checkpoint of the training of a larger network (--width) with the same --target, whose "
            "answers are learned beside the labels.",
        ),
    ] = None,
    seasons: Annotated[
        bool,
        typer.Option(
            "--seasons",
            help="Vary as seasons and weather do: one material recoloured at a time, mist and dusk; and "
            "show far ground as large as it is looked at.",
        ),
    ] = False,
    wide: Annotated[
        bool,
        typer.Option("--wide", help="Vary beyond what was rendered: clutter, cameras, sizes of people."),
    ] = False,
    licence: Annotated[
        str | None, typer.Option("--licence", help="Licence of the weights, written into the model.")
    ] = None,
    origin: options.Origin = None,
    assume_local: options.AssumeLocal = False,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with an interrupted training.")] = False,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Train the crowd detector on labelled missions (needs `crowdfence\\[train]`).

    Writes the model, <model>.checkpoint while it runs, and a folder <model>.report with figures, curves and
    example pictures. Run `crowdfence calibrate` on other missions before you rely on its probabilities.
    """
    for option, given in (("--initial", initial), ("--teacher", teacher)):
        if not (given is None or given.is_file()):
            raise FileNotFoundError(f"{option} {given}: there is no such checkpoint")
    if output.suffix != ".onnx":
        raise ValueError(
            f"--output {output}: a model's name ends in .onnx, beside which the others are written"
        )
    if live_statistics and (initial is None or initial.suffix != ".onnx"):
        raise ValueError(
            "--live-statistics is for a training that starts from a model (--initial MODEL.onnx); all others "
            "have statistics that follow"
        )
    folder = store or output.with_suffix(".frames")
    read = (initial, teacher)
    with _writable(output, read, resume=resume, force=force), writable_folder(folder, parents=True):
        from crowdfence.detector_training.frame_store import store_missions
        from crowdfence.detector_training.onnx_export import export_onnx
        from crowdfence.detector_training.report import training_facts, write_report
        from crowdfence.detector_training.trainer import initial_weights, teacher_of
        from crowdfence.detector_training.trainer import train as train_network
        from crowdfence.evaluation.labelled_missions import mission_names

        plan = _plan(
            target, {"steps": steps, "batch": batch, "width": width, "learning_rate": learning_rate}, seed
        )
        if seasons:
            plan = replace(plan, seasons=True, crops=replace(plan.crops, scale=SEASONS_SCALE))
        if wide:
            plan = replace(
                plan, wide=True, crops=replace(plan.crops, wide=WIDE_CROPS, photographs=WIDE_PHOTOGRAPHS)
            )
        start = _start(initial)
        if start is not None:
            plan = replace(plan, frozen_statistics=not live_statistics, vibrance=start.input.vibrance)
        if initial is not None:
            initial_weights(initial, plan)  # what cannot be started from is said before minutes of decoding
        if teacher is not None and (smaller := teacher_of(teacher, plan).width) < plan.width:
            console.warn(
                f"--teacher {teacher} has width {smaller:g}, this training {plan.width:g}: it learns the "
                "answers of a smaller network"
            )
        paths, held_out = options.recordings_in(data), options.recordings_in(validation)
        twice = {path.resolve() for path in paths} & {path.resolve() for path in held_out}
        if twice:
            raise ValueError(
                f"{min(twice)} is given for training and for validation; it can serve only one of them"
            )
        for some in (paths, held_out):
            resolved = [path.resolve() for path in some]
            if again := [path for path in some if resolved.count(path.resolve()) > 1]:
                raise ValueError(f"{again[0]} is given twice; its frames would count double")
        map_options = options.terrain_options(origin=origin, assume_local=assume_local)
        stored: list[StoredMission] = []
        with console.progress("decoding", len(paths) + len(held_out), "missions") as advance:
            for some in (paths, held_out):
                stored += store_missions(
                    some,
                    plan.targets,
                    folder,
                    workers=workers,
                    terrain_options=map_options,
                    vibrance=plan.vibrance,
                    on_mission=lambda mission: advance(),
                )
        names = mission_names([*paths, *held_out])
        stored = [replace(mission, name=name) for mission, name in zip(stored, names, strict=True)]
        for mission in stored:
            for doubt in mission.doubts:
                console.warn(f"{mission.name}: {doubt}")
            if mission.skipped:
                count, first = counted(len(mission.skipped), "frame"), mission.skipped[0]
                console.warn(f"{mission.name}: skipped {count}, the first: {first}")
        learned, judged = stored[: len(paths)], stored[len(paths) :]
        with console.progress("training", plan.steps, "steps") as advance:
            try:
                trained = train_network(
                    learned,
                    judged,
                    plan,
                    checkpoint=output.with_suffix(".checkpoint"),
                    resume=resume,
                    initial=initial,
                    teacher=teacher,
                    on_step=lambda step: advance(),
                    on_checkup=None if as_json else _tell,
                )
            except KeyboardInterrupt:
                console.fail("interrupted; the same command with --resume goes on")
                raise typer.Exit(INTERRUPTED) from None
        facts = training_facts(trained, plan, learned, judged)
        export_onnx(trained.network, 0, _contract(output, plan, facts, licence, start), output)
        write_report(output.with_suffix(".report"), trained, plan, learned, judged)
    _warn_of_worse(trained, plan, initial)
    if as_json:
        console.print_json(facts)
    else:
        _report(trained, plan, output)


@contextmanager
def _writable(output: Path, read: tuple[Path | None, ...], *, resume: bool, force: bool) -> Iterator[None]:
    """The model, and what is written beside it. What an earlier training left is its own to go on with."""
    checkpoint = output.with_suffix(".checkpoint")
    if checkpoint.exists() and not (resume or force):
        raise FileExistsError(f"{checkpoint} exists; --resume goes on with it, --force replaces it")
    force = force or checkpoint.exists()
    require_replaceable(output.with_suffix(".report"), force=force)
    with ExitStack() as stack:
        stack.enter_context(replaceable_file(output, force=force))
        stack.enter_context(replaceable_file(checkpoint, force=force, reads=read))
        yield


def _plan(target: list[options.LabelTarget] | None, given: dict[str, Any], seed: int) -> TrainingPlan:
    from crowdfence.detector_training.labels import TARGETS
    from crowdfence.detector_training.plan import TrainingPlan

    wanted = [one.value for one in target or [options.LabelTarget.ground]]
    targets = tuple(one for name in wanted for one in TARGETS if one == name)
    chosen = {name: value for name, value in given.items() if value is not None}
    return TrainingPlan(targets=targets, seed=seed, **chosen)


def _start(initial: Path | None) -> Contract | None:
    """What the model says that a training starts from; None without one, or with a checkpoint."""
    if initial is None or initial.suffix != ".onnx":
        return None
    from crowdfence.detector.contract.lookup import load_contract

    contract = load_contract(initial)
    if contract.input.color != "RGB":
        raise ValueError(
            f"{initial} is shown pictures as {contract.input.color}, and training shows RGB: it would learn "
            "colours that it is never shown"
        )
    return contract


def _contract(
    output: Path,
    plan: TrainingPlan,
    facts: dict[str, Any],
    licence: str | None,
    start: Contract | None = None,
) -> Contract:
    """Of the trained model. One that started from another is shown pictures as that one, and has its licence;
    what was measured of that one is not said of it."""
    from crowdfence._core import __version__
    from crowdfence.calibration.model_file import sizes_before
    from crowdfence.detector.contract.contract import Contract
    from crowdfence.detector_training.labels import STRIDE
    from crowdfence.detector_training.network import MULTIPLE_OF
    from crowdfence.truth.frame_labels import TARGET_HEIGHT_M

    contract = Contract.from_json(
        {
            "schema": 1,
            "name": output.stem,
            "version": __version__,
            "licence": licence,
            "input": {
                "name": "image",
                "layout": "NHWC",
                "dtype": "uint8",
                "color": "RGB",
                "multiple_of": MULTIPLE_OF,
                "resize": "none",
            },
            "output": {"name": "heatmap", "kind": "probability", "layout": "NCHW", "stride": STRIDE},
            "target_height_m": TARGET_HEIGHT_M[plan.targets[0]],
            "about": {"marks": plan.targets[0], "parameters": facts["parameters"], "seed": plan.seed}
            | ({"teacher": facts["teacher"]} if facts.get("teacher") else {}),
        }
    )
    if start is None:
        return contract
    return replace(
        contract,
        input=replace(start.input, name=contract.input.name),
        sizes=sizes_before(start),
        licence=licence or start.licence,
        about={**(contract.about or {}), "started_from": " ".join(filter(None, (start.name, start.version)))},
    )


def _tell(checkup: Checkup) -> None:
    quality = ", ".join(f"{target} IoU {checkup.score.iou(target):.3f}" for target in checkup.score.cells)
    learned = "" if checkup.loss is None else f"loss {checkup.loss:.4f}, "
    console.stderr().print(
        f"step {checkup.step}, {checkup.seconds / 60:.1f} min: {learned}validation "
        f"{checkup.score.loss:.4f}, {quality}"
    )


def _warn_of_worse(trained: Trained, plan: TrainingPlan, initial: Path | None) -> None:
    start, target = trained.start, plan.targets[0]
    if start is not None and trained.worse_than_start(target):
        console.warn(
            f"on the validation missions the new model is worse than {initial}, from which it started: pixel "
            f"IoU {trained.best.score.iou(target):.3f} instead of {start.score.iou(target):.3f}; a smaller "
            "--learning-rate, more --steps or more --data may help"
        )


def _report(trained: Trained, plan: TrainingPlan, output: Path) -> None:
    best = trained.best
    target = plan.targets[0]
    cells = best.score.cells[target]
    console.stdout().print(
        console.facts(
            f"{output}: marks {target}",
            {
                "kept": f"step {best.step} of {plan.steps}"
                + (", stopped early" if trained.stopped_early else ""),
                "pixel IoU": f"{best.score.iou(target):.3f} on the validation missions"
                + (f", {trained.start.score.iou(target):.3f} before" if trained.start else ""),
                "TPR, FPR": f"{cells.true_positive_rate().rate:.3f}, {cells.false_positive_rate().rate:.4f}",
                "report": str(output.with_suffix(".report")),
                "next": f"crowdfence calibrate {output} --data ... (missions that were in neither group)",
            },
        )
    )
