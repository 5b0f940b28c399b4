"""The paper's study in miniature: a training per row and seed, and the table that they make.

out/trainings/<row>/seed-<n>/   trainings, as `webgym train` makes them
out/study.json                  success over trajectories, per row and seed: what is in it is not made again,
                                so a study goes on elsewhere with this file alone
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
from webgym.plotting import CATEGORIES, PAGE, new_figure, save, styled
from webgym.rollout.files import CONFIG, write_whole
from webgym.settings import Settings, load_settings, merged
from webgym.train.folder import TrainingFolder
from webgym.train.loop import TrainConfig
from webgym.train.start import open_training, read_config

RESULTS: Final = "study.json"
SETTINGS: Final = Path(__file__).parent / "study.yaml"


class Row(Settings):
    """A row of the study."""

    paper: tuple[float, float] | None = None
    """The paper's success before and at the peak, per cent; ``None`` for a row of our own."""

    settings: dict[str, Any] = Field(default_factory=dict)
    """Laid over the base."""


class StudyConfig(Settings):
    """The whole study."""

    base: dict[str, Any]
    """Settings of a training that all rows share; the model is filled in."""

    rows: dict[str, Row]
    """By name, in the order of the table."""

    findings: dict[str, tuple[str, str]] = Field(default_factory=dict)
    """What the paper found: rows of which the first came out better than the second."""

    def training(self, row: str, seed: int, weights: Path) -> TrainConfig:
        """The settings of a training that begins with these weights.

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
    """What a training came to: success on the test tasks, with how many trajectories it took to get there.

    Attributes:
        row, seed: of the training.
        trajectories: before each evaluation.
        success: of each evaluation; empty until the training is finished.
        settings: hash of what the training was begun with, first weights included.
    """

    row: str
    seed: int
    trajectories: list[int]
    success: list[float]
    settings: str = ""

    @property
    def before(self) -> float:
        """Success of the first weights."""
        return self.success[0]

    @property
    def peak(self) -> float:
        """The best success of an evaluation after learning, as the paper reports it."""
        return max(self.success[1:])

    @property
    def last(self) -> float:
        """Success of the last weights, which nothing was chosen by."""
        return self.success[-1]


def read_study(files: Sequence[Path]) -> StudyConfig:
    """The study that comes with the package, with files laid over it.

    Raises:
        ConfigError: a file cannot be read, or a setting is unknown.
    """
    return load_settings(StudyConfig, [SETTINGS, *files], hint=f"see {SETTINGS}")


async def carry_out(
    study: StudyConfig,
    weights: Path,
    rows: Sequence[str],
    seeds: int,
    out: Path,
    tell: Callable[[str], None],
) -> list[Result]:
    """Make every training that is not finished yet, seed by seed, so that whole tables come first.

    Args:
        study: the rows.
        weights: that every training begins with.
        rows: names of those to make.
        seeds: trainings per row, seeds from 1.
        out: folder; what is in it is gone on from.
        tell: is told what goes on.

    Raises:
        RunFolderError: ``study.json`` cannot be read, or a training in it was begun with other settings.
    """
    results = {(each.row, each.seed): each for each in _read(out / RESULTS)}
    evaluated: dict[str, TrainingFolder] = {}  # the first weights are, once for all rows with the same agent
    first = await asyncio.to_thread(_hash_of, weights)
    wanted = [(row, seed) for seed in range(1, seeds + 1) for row in rows]
    for number, (row, seed) in enumerate(wanted, start=1):
        config = study.training(row, seed, weights)
        folder = TrainingFolder(out / "trainings" / _slug(row) / f"seed-{seed}")
        tell(f"training {number} of {len(wanted)}: {row}, seed {seed}")
        settings, same = _settings(config, first), evaluated.get(_evaluation_of(config))
        begun = results.setdefault((row, seed), Result(row, seed, [], [], settings))
        if begun.settings not in ("", settings):
            raise RunFolderError(
                f"{out / RESULTS}: {row}, seed {seed} was made with other settings or first weights",
                hint="give another folder, or take it out of that file and its folder out of trainings/",
            )
        if begun.success and begun.settings:
            continue
        write(study, list(results.values()), out)
        if folder.stage(config.loop.iterations) is not None:
            resume = (folder.path / CONFIG).exists()
            held = read_config(folder.path) if resume else config
            async with open_training(held, folder.path, resume=resume, tell=tell) as training:
                if same is not None and not folder.is_evaluated(0):
                    _copy_evaluation(same, folder)
                await training.run()
        if folder.is_evaluated(0):
            evaluated.setdefault(_evaluation_of(config), folder)
        results[row, seed] = msgspec.structs.replace(result_of(folder, row, seed), settings=settings)
        write(study, list(results.values()), out)
    return [results[each] for each in wanted]


def _evaluation_of(config: TrainConfig) -> str:
    """What an evaluation of the first weights depends on; not on what is drawn and learned from."""
    budgets = {f"budget_{difficulty}" for difficulty in ("easy", "medium", "hard")}
    learning: Any = dict.fromkeys(("loop", "sampler", "learn", "seed"), True)
    return config.model_dump_json(exclude=learning | {"rollout": {"attempt": budgets, "samples": True}})


def _copy_evaluation(made: TrainingFolder, folder: TrainingFolder) -> None:
    source, own = made.evaluation(0), folder.evaluation(0)
    shutil.copytree(source, own, dirs_exist_ok=True)
    shutil.copy(source.with_suffix(".json"), own.with_suffix(".json"))  # last: it says that all is there


def _read(path: Path) -> list[Result]:
    try:
        return msgspec.json.decode(path.read_bytes(), type=list[Result]) if path.exists() else []
    except msgspec.DecodeError as error:
        raise RunFolderError(f"{path} holds no results: {error}") from error


def _hash_of(weights: Path) -> str:
    """Of the model's content: it lies elsewhere on another machine."""
    found = hashlib.sha256()
    for path in sorted([*weights.glob("*.safetensors"), *weights.glob("*.json")]):
        found.update(path.name.encode() + hashlib.sha256(path.read_bytes()).digest())
    return found.hexdigest()


def _settings(config: TrainConfig, weights: str) -> str:
    """Hash of what a training is made with: of what is set, since defaults may be added to."""
    places: Any = {"learn": {"model"}, "local": {"path"}}
    held = config.model_dump(mode="json", exclude_unset=True, exclude=places)
    return hashlib.sha256(f"{weights} {json.dumps(held, sort_keys=True)}".encode()).hexdigest()[:16]


def result_of(folder: TrainingFolder, row: str, seed: int) -> Result:
    """What a finished training came to."""
    evaluations = folder.evaluations()
    collected = {0: 0} | {each["iteration"]: each["trajectories"] for each in folder.write_metrics()}
    return Result(
        row,
        seed,
        [collected[number] for number in sorted(evaluations)],
        [evaluations[number]["success_rate"]["overall"] for number in sorted(evaluations)],
    )


def write(study: StudyConfig, results: Sequence[Result], out: Path) -> None:
    """Table and figure of what there is so far."""
    write_whole(out / RESULTS, msgspec.json.format(msgspec.json.encode(results)))
    finished = [each for each in results if each.success]
    (out / "study.md").write_text("\n".join([*table(study, finished), "", *findings(study, finished)]) + "\n")
    if finished:
        _draw(finished, out / "study.png")


def table(study: StudyConfig, results: Sequence[Result]) -> Iterator[str]:
    """The table in Markdown: mean and standard deviation over seeds, per cent."""
    yield "| row | seeds | before | after | peak | rise | the paper: before, peak, rise |"
    yield "|---|---|---|---|---|---|---|"
    for row, found in _by_row(results).items():
        paper = study.rows[row].paper if row in study.rows else None
        theirs = f"{paper[0]:.1f}, {paper[1]:.1f}, {paper[1] - paper[0]:+.1f}" if paper else ""
        figures = (
            [each.before for each in found],
            [each.last for each in found],
            [each.peak for each in found],
            [each.last - each.before for each in found],
        )
        yield f"| {row} | {len(found)} | {' | '.join(map(_spread, figures))} | {theirs} |"


def findings(study: StudyConfig, results: Sequence[Result]) -> Iterator[str]:
    """The paper's findings in Markdown, each with the 95 % interval of its difference (Welch's t)."""
    rows = _by_row(results)
    yield "| the paper's finding | difference after training, 95 % | repeats? |"
    yield "|---|---|---|"
    for says, (better, worse) in study.findings.items():
        first, second = ([each.last for each in rows.get(row, [])] for row in (better, worse))
        if min(len(first), len(second)) < 2:
            continue
        difference, half = mean(first) - mean(second), _half_width(first, second)
        verdict = "not decided"
        if abs(difference) > half > 0:
            verdict = "yes" if difference > 0 else "no, the opposite"
        yield f"| {says} | {100 * difference:+.1f} ± {100 * half:.1f} | {verdict} |"


_STUDENT: Final = (12.71, 4.30, 3.18, 2.78, 2.57, 2.45, 2.36, 2.31, 2.26)
"""97.5 % quantiles of Student's t with 1, 2, … degrees of freedom; the last serves for more."""


def _half_width(first: Sequence[float], second: Sequence[float]) -> float:
    """Of the 95 % interval of a difference of means, degrees of freedom rounded down; 0 without spread."""
    one, other = variance(first) / len(first), variance(second) / len(second)
    if not one + other:
        return 0.0
    freedom = (one + other) ** 2 / (one**2 / (len(first) - 1) + other**2 / (len(second) - 1))
    return _STUDENT[min(int(freedom), len(_STUDENT)) - 1] * math.sqrt(one + other)


def _spread(values: Sequence[float]) -> str:
    about = f" ± {100 * stdev(values):.1f}" if len(values) > 1 else ""
    return f"{100 * mean(values):.1f}{about}"


def _by_row(results: Sequence[Result]) -> Mapping[str, list[Result]]:
    found: dict[str, list[Result]] = {}
    for result in results:
        found.setdefault(result.row, []).append(result)
    return found


def _draw(results: Sequence[Result], path: Path) -> None:
    with styled():
        figure = new_figure(PAGE, 3.0)
        axes = figure.subplots()
        for number, (row, found) in enumerate(_by_row(results).items()):
            points = list(zip(*(each.success for each in found), strict=True))
            axes.plot(
                found[0].trajectories,
                [100 * mean(each) for each in points],
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
