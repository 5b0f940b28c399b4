"""The paper's study in miniature: a training per row and seed, and a table of the results.

out/trainings/<row>/seed-<n>/   training folders of `webgym train`
out/study.json                  success over trajectories, per row and seed; trainings in it are not repeated,
                                so this file alone suffices to continue a study on another machine
out/study.md                    the table
out/study.png                   success over trajectories
"""

from __future__ import annotations

import asyncio
import hashlib
import json
import math
import re
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from statistics import mean, stdev, variance
from typing import Any, Final

import msgspec
from pydantic import Field

from webgym.core.errors import RunFolderError, UsageError
from webgym.core.plotting import CATEGORIES, PAGE, new_figure, save, styled
from webgym.core.settings import Settings, load_settings, merged
from webgym.store.files import CONFIG, TORN, write_whole
from webgym.train.folder import TrainingFolder
from webgym.train.loop import TrainConfig
from webgym.train.start import open_training, read_config

RESULTS: Final = "study.json"
SETTINGS: Final = Path(__file__).parent / "study.yaml"


class Row(Settings):
    """A row of the study."""

    paper: tuple[float, float] | None = None
    """The paper's success before training and at the peak, per cent; ``None`` for a row of our own."""

    settings: dict[str, Any] = Field(default_factory=dict)
    """Settings that override the base."""


class StudyConfig(Settings):
    """Settings of the study."""

    base: dict[str, Any]
    """Training settings common to all rows; the model is filled in."""

    rows: dict[str, Row]
    """Rows by name, in the order of the table."""

    findings: dict[str, tuple[str, str]] = Field(default_factory=dict)
    """The paper's findings: for each, two rows of which the first was better than the second."""

    def training(self, row: str, seed: int, weights: Path) -> TrainConfig:
        """The settings of a training with these initial weights.

        Raises:
            UsageError: there is no such row.
        """
        if row not in self.rows:
            raise UsageError(f"unknown row {row!r}", hint=f"rows: {', '.join(self.rows)}")
        own = {
            "seed": seed,
            "learn": {"model": str(weights), "update": {"seed": seed}},
            "local": {"path": str(weights), "threads": 1},
        }
        return TrainConfig.model_validate(merged(merged(own, self.base), self.rows[row].settings))


class Result(msgspec.Struct):
    """The result of a training: success on the test tasks over the number of trajectories.

    Attributes:
        row, seed: of the training.
        trajectories: number collected before each evaluation.
        success: success rate of each evaluation, ``None`` without a judged attempt; empty until the training
            is finished.
        settings: hash of the training's settings and initial weights.
    """

    row: str
    seed: int
    trajectories: list[int]
    success: list[float | None]
    settings: str = ""

    @property
    def rates(self) -> list[float]:
        """Success of all evaluations; empty, and so in no table or figure, if one is unknown."""
        rates = [rate for rate in self.success if rate is not None]
        return rates if len(rates) == len(self.success) else []

    @property
    def before(self) -> float:
        """Success of the initial weights."""
        return self.rates[0]

    @property
    def peak(self) -> float:
        """The best success of an evaluation during training, as reported in the paper."""
        return max(self.rates[1:])

    @property
    def last(self) -> float:
        """Success of the final weights, free of selection bias."""
        return self.rates[-1]


def read_study(files: Sequence[Path], overrides: Mapping[str, Any] | None = None) -> StudyConfig:
    """The study included in the package, with files and options that override its settings.

    Raises:
        ConfigError: a file cannot be read, or a setting is unknown.
    """
    return load_settings(StudyConfig, [SETTINGS, *files], f"see {SETTINGS}", overrides)


async def carry_out(
    study: StudyConfig, weights: Path, rows: Sequence[str], seeds: int, out: Path, tell: Callable[[str], None]
) -> list[Result]:
    """Run all unfinished trainings, seed by seed, so that complete tables come first.

    Args:
        study: the rows.
        weights: the initial weights of every training.
        rows: names of the rows to run.
        seeds: number of trainings per row; their seeds start at 1.
        out: output folder; trainings in it are continued.
        tell: called with lines about the progress.

    Raises:
        RunFolderError: ``study.json`` cannot be read, or a training in it was started with other settings.
    """
    results = {(result.row, result.seed): result for result in _read(out / RESULTS)}
    # Rows with the same agent reuse the evaluation of the initial weights.
    evaluated: dict[str, TrainingFolder] = {}
    first = await asyncio.to_thread(_hash_of, weights)
    trainings = [(row, seed) for seed in range(1, seeds + 1) for row in rows]
    for number, (row, seed) in enumerate(trainings, start=1):
        config = study.training(row, seed, weights)
        folder = TrainingFolder(out / "trainings" / _slug(row) / f"seed-{seed}")
        tell(f"training {number} of {len(trainings)}: {row}, seed {seed}")
        settings, reusable = _settings(config, first), evaluated.get(_evaluation_of(config))
        result_so_far = results.setdefault((row, seed), Result(row, seed, [], [], settings))
        if result_so_far.settings not in ("", settings):
            raise RunFolderError(
                f"{out / RESULTS}: {row}, seed {seed} was made with other settings or first weights",
                hint="give another folder, or take it out of that file and its folder out of trainings/",
            )
        if not (result_so_far.success and result_so_far.settings):
            write(study, list(results.values()), out)
            if folder.stage(config.loop.iterations) is not None:
                resume = (folder.path / CONFIG).exists()
                training_config = read_config(folder.path) if resume else config
                async with open_training(training_config, folder.path, resume=resume, tell=tell) as training:
                    if reusable is not None and not folder.evaluation(0).exists():
                        _copy_evaluation(reusable, folder)
                    await training.run()
            results[row, seed] = msgspec.structs.replace(result_of(folder, row, seed), settings=settings)
            write(study, list(results.values()), out)
        if None in results[row, seed].success:
            tell(
                f"{row}, seed {seed} is in no table or figure, as no attempt of an evaluation was judged; "
                f"to repeat it, take it out of {out / RESULTS} and its folder out of trainings/"
            )
        if folder.is_evaluated(0):
            evaluated.setdefault(_evaluation_of(config), folder)
    return [results[result] for result in trainings]


def _evaluation_of(config: TrainConfig) -> str:
    """Everything on which an evaluation of the initial weights depends, as a key."""
    budgets = {f"budget_{difficulty}" for difficulty in ("easy", "medium", "hard")}
    learning: Any = dict.fromkeys(("loop", "sampler", "learn", "seed"), True)
    return config.model_dump_json(exclude=learning | {"rollout": {"attempt": budgets, "samples": True}})


def _copy_evaluation(made: TrainingFolder, folder: TrainingFolder) -> None:
    """Copy an evaluation, of which no part appears if this is killed; the training deletes what it left."""
    source, own = made.evaluation(0), folder.evaluation(0)
    unfinished = own.with_name(f".{own.name}{TORN}")
    shutil.copytree(source, unfinished)
    unfinished.replace(own)
    # Last, because this file marks the evaluation as complete.
    shutil.copy(source.with_suffix(".json"), own.with_suffix(".json"))


def _read(path: Path) -> list[Result]:
    try:
        return msgspec.json.decode(path.read_bytes(), type=list[Result]) if path.exists() else []
    except ValueError as error:
        raise RunFolderError(f"{path} holds no results: {error}") from error


def _hash_of(weights: Path) -> str:
    """Hash of a model's files, independent of their folder."""
    digest = hashlib.sha256()
    for path in sorted([*weights.glob("*.safetensors"), *weights.glob("*.json")]):
        digest.update(path.name.encode() + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def _settings(config: TrainConfig, weights: str) -> str:
    """Hash of a training's explicit settings and initial weights; new defaults do not change it."""
    paths: Any = {"learn": {"model"}, "local": {"path"}}
    explicit = config.model_dump(mode="json", exclude_unset=True, exclude=paths)
    return hashlib.sha256(f"{weights} {json.dumps(explicit, sort_keys=True)}".encode()).hexdigest()[:16]


def result_of(folder: TrainingFolder, row: str, seed: int) -> Result:
    """The result of a finished training."""
    evaluations = folder.evaluations()
    collected = {0: 0} | {result["iteration"]: result["trajectories"] for result in folder.write_metrics()}
    return Result(
        row,
        seed,
        [collected[number] for number in sorted(evaluations)],
        [evaluations[number]["success_rate"]["overall"] for number in sorted(evaluations)],
    )


def write(study: StudyConfig, results: Sequence[Result], out: Path) -> None:
    """Write the results so far, their table and their figure."""
    write_whole(out / RESULTS, msgspec.json.format(msgspec.json.encode(results)))
    (out / "study.md").write_text("\n".join([*table(study, results), "", *findings(study, results)]) + "\n")
    if any(result.rates for result in results):
        _draw(results, out / "study.png")


def table(study: StudyConfig, results: Sequence[Result]) -> Iterator[str]:
    """The table in Markdown: mean and standard deviation over seeds, per cent."""
    yield "| row | seeds | before | after | peak | rise | the paper: before, peak, rise |"
    yield "|---|---|---|---|---|---|---|"
    for row, row_results in _by_row(results).items():
        paper = study.rows[row].paper if row in study.rows else None
        paper_cells = f"{paper[0]:.1f}, {paper[1]:.1f}, {paper[1] - paper[0]:+.1f}" if paper else ""
        figures = (
            [result.before for result in row_results],
            [result.last for result in row_results],
            [result.peak for result in row_results],
            [result.last - result.before for result in row_results],
        )
        yield f"| {row} | {len(row_results)} | {' | '.join(map(_spread, figures))} | {paper_cells} |"


def findings(study: StudyConfig, results: Sequence[Result]) -> Iterator[str]:
    """The paper's findings in Markdown, each with the 95 % interval of its difference (Welch's t)."""
    rows = _by_row(results)
    yield "| the paper's finding | difference after training, 95 % | repeats? |"
    yield "|---|---|---|"
    for finding, (better, worse) in study.findings.items():
        first, second = ([result.last for result in rows.get(row, [])] for row in (better, worse))
        if min(len(first), len(second)) < 2:
            continue
        difference, half = mean(first) - mean(second), _half_width(first, second)
        verdict = "not decided"
        if abs(difference) > half > 0:
            verdict = "yes" if difference > 0 else "no, the opposite"
        yield f"| {finding} | {100 * difference:+.1f} ± {100 * half:.1f} | {verdict} |"


_STUDENT: Final = (12.71, 4.30, 3.18, 2.78, 2.57, 2.45, 2.36, 2.31, 2.26)
"""97.5 % quantiles of Student's t with 1, 2, … degrees of freedom; the last is used for more."""


def _half_width(first: Sequence[float], second: Sequence[float]) -> float:
    """Half of a difference of means' 95 % interval, degrees of freedom rounded down; 0 without variance."""
    a, b = variance(first) / len(first), variance(second) / len(second)
    if not a + b:
        return 0.0
    freedom = (a + b) ** 2 / (a**2 / (len(first) - 1) + b**2 / (len(second) - 1))
    return _STUDENT[min(int(freedom), len(_STUDENT)) - 1] * math.sqrt(a + b)


def _spread(values: Sequence[float]) -> str:
    about = f" ± {100 * stdev(values):.1f}" if len(values) > 1 else ""
    return f"{100 * mean(values):.1f}{about}"


def _by_row(results: Sequence[Result]) -> Mapping[str, list[Result]]:
    """The finished results whose evaluations all have a success rate."""
    by_row: dict[str, list[Result]] = {}
    for result in filter(lambda result: result.rates, results):
        by_row.setdefault(result.row, []).append(result)
    return by_row


def _draw(results: Sequence[Result], path: Path) -> None:
    with styled():
        figure = new_figure(PAGE, 3.0)
        axes = figure.subplots()
        for number, (row, row_results) in enumerate(_by_row(results).items()):
            points = list(zip(*(result.rates for result in row_results), strict=True))
            axes.plot(
                row_results[0].trajectories,
                [100 * mean(point) for point in points],
                color=CATEGORIES[number % len(CATEGORIES)],
                linestyle=("-", "--")[number // len(CATEGORIES) % 2],
                label=row,
            )
        axes.set_xlabel("trajectories collected")
        axes.set_ylabel("success on unseen websites, %")
        axes.grid(axis="y")
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
        save(figure, path)


def _slug(row: str) -> str:
    return re.sub(r"\W+", "-", row)
