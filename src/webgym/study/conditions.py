"""The paper's study in miniature: a training per row and seed, and a table of the results.

A training's result is the area under its curve: mean success over the trajectories collected.

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
import time
from collections import defaultdict
from collections.abc import Container, Iterator, Mapping, Sequence
from itertools import accumulate
from pathlib import Path
from statistics import NormalDist, mean, stdev
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
from pydantic import Field

from webgym.core.errors import RunFolderError, UsageError
from webgym.core.plotting import CATEGORIES, PAGE, new_figure, save, styled
from webgym.core.settings import Settings, load_settings, merged
from webgym.run.choice import all_tasks
from webgym.store.files import CONFIG, TORN, write_whole
from webgym.store.runs import RunReader
from webgym.train.figures import judged
from webgym.train.folder import TrainingFolder
from webgym.train.loop import Tell, TrainConfig
from webgym.train.start import open_training, read_config, warm_start

RESULTS: Final = "study.json"
SETTINGS: Final = Path(__file__).parent / "study.yaml"

LEAST_FREEDOM: Final = 2
"""Degrees of freedom from which on a spread says something."""

SPREAD: Final = 0.018
"""Standard deviation that is expected of a training's result, apart from what row and seed explain."""

CORE_HOURS: Final = 0.12
"""Processor time that is expected of a training, hours."""

_CONFIDENT, _POWER = 0.975, 0.8


class Row(Settings):
    """A row of the study."""

    paper: tuple[float, float] | None = None
    """The paper's success before training and at the peak, per cent; ``None`` for a row of our own."""

    settings: dict[str, Any] = Field(default_factory=dict)
    """Settings that override the base."""

    start: str | None = None
    """A row above; the successes among the attempts of its first iteration are cloned first (warm start),
    and those attempts count as trajectories of this row, too."""


class Finding(Settings):
    """That one row is better than another."""

    better: str
    """The row that is held to be better."""

    worse: str
    """The other."""

    kinds: tuple[str, ...] = ()
    """Subdomains whose test tasks count; all by default."""


class StudyConfig(Settings):
    """Settings of the study."""

    base: dict[str, Any]
    """Training settings common to all rows; the model is filled in."""

    rows: dict[str, Row]
    """Rows by name, in the order of the table."""

    findings: dict[str, Finding] = Field(default_factory=dict)
    """The paper's findings, and controls."""

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
        trajectories: number with a reward, collected before each evaluation.
        success: success rate of each evaluation, ``None`` without a judged attempt; empty until the training
            is finished.
        settings: hash of the training's settings and initial weights.
        kinds: successes and judged attempts of each evaluation, by the tasks' subdomain.
        core_hours: processor time; ``None`` if it was made in several parts.
    """

    row: str
    seed: int
    trajectories: list[int]
    success: list[float | None]
    settings: str = ""
    kinds: dict[str, list[tuple[int, int]]] = {}
    core_hours: float | None = None

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
    def last(self) -> float:
        """Success of the final weights, free of the selection bias of a peak."""
        return self.rates[-1]

    @property
    def places(self) -> list[int]:
        """Where each evaluation was made, in twentieths of the trajectories."""
        return [round(20 * number / (self.trajectories[-1] or 1)) for number in self.trajectories]

    def area(self, on: Sequence[str] = (), at: Container[int] = range(21)) -> float | None:
        """Mean success over the trajectories collected, by the trapezoidal rule.

        Args:
            on: subdomains whose tasks count; all by default. ``None`` if none of them was attempted.
            at: :attr:`places` of the evaluations that count; all by default.
        """
        rates = self.rates
        if on:
            counts = list(zip(*(self.kinds[kind] for kind in on if kind in self.kinds), strict=True))
            if not counts or not all(sum(count for _, count in each) for each in counts):
                return None
            rates = [sum(right for right, _ in each) / sum(count for _, count in each) for each in counts]
        points = zip(self.places, self.trajectories, rates, strict=True)
        where, height = np.array([(number, rate) for place, number, rate in points if place in at]).T
        width = where[-1] - where[0]
        return float(np.trapezoid(height, where)) / width if width else None


def read_study(files: Sequence[Path], overrides: Mapping[str, Any] | None = None) -> StudyConfig:
    """The study included in the package, with files and options that override its settings.

    Raises:
        ConfigError: a file cannot be read, or a setting is unknown.
    """
    return load_settings(StudyConfig, [SETTINGS, *files], f"see {SETTINGS}", overrides)


async def carry_out(
    study: StudyConfig, weights: Path, rows: Sequence[str], seeds: int, out: Path, tell: Tell
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
        UsageError: what a row starts from is not in ``out``.
    """
    results = {(result.row, result.seed): result for result in read_results(out)}
    # Rows with the same agent reuse the evaluation of the initial weights.
    evaluated: dict[str, TrainingFolder] = {}
    weights_hash = await asyncio.to_thread(_hash_of, weights)
    trainings = [(row, seed) for seed in range(1, seeds + 1) for row in rows]
    for number, (row, seed) in enumerate(trainings, start=1):
        config = study.training(row, seed, weights)
        folder, start = _folder(out, row, seed), study.rows[row].start
        tell(f"training {number} of {len(trainings)}: {row}, seed {seed}")
        settings = _settings(config, weights_hash if start is None else f"{weights_hash} {start}")
        reusable = evaluated.get(_evaluation_of(config)) if start is None else None
        result_so_far = results.setdefault((row, seed), Result(row, seed, [], [], settings))
        if result_so_far.settings not in ("", settings):
            raise RunFolderError(
                f"{out / RESULTS}: {row}, seed {seed} was made with other settings or first weights",
                hint="give another folder, or take it out of that file and its folder out of trainings/",
            )
        if not (result_so_far.success and result_so_far.settings):
            write(study, list(results.values()), out)
            core_hours = None
            if folder.stage(config.loop.iterations) is not None:
                resume = (folder.path / CONFIG).exists()
                if start is not None:  # again, too, when it is resumed: what it starts from must be there
                    begun, first = results.get((start, seed)), _folder(out, start, seed)
                    config = await asyncio.to_thread(_warmed, config, begun, first, folder, tell)
                training_config, started = read_config(folder.path) if resume else config, time.process_time()
                async with open_training(training_config, folder.path, resume=resume, tell=tell) as training:
                    if reusable is not None and not folder.evaluation(0).exists():
                        _copy_evaluation(reusable, folder)
                    await training.run()
                core_hours = None if resume else (time.process_time() - started) / 3600
            found = result_of(folder, row, seed)
            if start is not None:
                found = _since(results[start, seed], _folder(out, start, seed), found)
            results[row, seed] = msgspec.structs.replace(found, settings=settings, core_hours=core_hours)
            write(study, list(results.values()), out)
        if None in results[row, seed].success:
            tell(
                f"{row}, seed {seed} is in no table or figure, as no attempt of an evaluation was judged; "
                f"to repeat it, take it out of {out / RESULTS} and its folder out of trainings/"
            )
        if start is None and folder.is_evaluated(0):
            evaluated.setdefault(_evaluation_of(config), folder)
    return [results[result] for result in trainings]


def _folder(out: Path, row: str, seed: int) -> TrainingFolder:
    return TrainingFolder(out / "trainings" / re.sub(r"\W+", "-", row) / f"seed-{seed}")


def _warmed(
    config: TrainConfig, begun: Result | None, first: TrainingFolder, folder: TrainingFolder, tell: Tell
) -> TrainConfig:
    """A training that starts from clones of the successes in the first iteration of one that is finished."""
    if begun is None or not begun.success or not first.run(1).exists():
        raise UsageError(
            f"{folder.path} starts from attempts in {first.path}, which is not there, or not finished",
            hint=f"train {first.path.parent.name} in the same folder before, with the same seeds",
        )
    to = folder.path.with_name(f"{folder.path.name}-start")
    return warm_start(config, [first.run(1)], all_tasks(config.rollout), to, tell)


def _since(first: Result, folder: TrainingFolder, result: Result) -> Result:
    """A result of a warm start, from the initial weights and the first attempt on."""
    before, shared = judged(folder.write_metrics()[0]["collect"]), first.kinds.keys() & result.kinds.keys()
    return msgspec.structs.replace(
        result,
        trajectories=[0, *(before + number for number in result.trajectories)],
        success=[first.success[0], *result.success],
        kinds={kind: [first.kinds[kind][0], *result.kinds[kind]] for kind in sorted(shared)},
    )


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


def read_results(out: Path) -> list[Result]:
    """The results in a study's folder so far.

    Raises:
        RunFolderError: ``study.json`` cannot be read.
    """
    path = out / RESULTS
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
    evaluations, rows = folder.evaluations(), folder.write_metrics()
    # Attempts that a resumed run threw away are on disk, too.
    collected = dict(enumerate(accumulate((judged(each["collect"]) for each in rows), initial=0)))
    kinds: defaultdict[str, list[tuple[int, int]]] = defaultdict(list)
    for number in sorted(evaluations):
        for kind, counts in _by_kind(RunReader(folder.evaluation(number))).items():
            kinds[kind].append(counts)
    return Result(
        row,
        seed,
        [collected[number] for number in sorted(evaluations)],
        [evaluations[number]["success_rate"]["overall"] for number in sorted(evaluations)],
        kinds={kind: counts for kind, counts in kinds.items() if len(counts) == len(evaluations)},
    )


def _by_kind(run: RunReader) -> Mapping[str, tuple[int, int]]:
    """Successes and attempts with a reward, by subdomain."""
    found: defaultdict[str, tuple[int, int]] = defaultdict(lambda: (0, 0))
    for trajectory in run.trajectories():
        if (reward := trajectory.outcome.reward) is not None:
            right, count = found[kind := run.tasks[trajectory.episode.task_id].subdomain]
            found[kind] = right + int(reward), count + 1
    return found


def plan(study: StudyConfig, rows: Sequence[str], seeds: int, results: Sequence[Result]) -> Iterator[str]:
    """What so many seeds of these rows cost, and what those that learn from rewards can show. The more
    ``results`` of finished trainings there are, the less is assumed."""
    hours = [result.core_hours for result in results if result.core_hours is not None]
    trainings, each = len(rows) * seeds, mean(hours) if hours else CORE_HOURS
    yield (
        f"{len(rows)} rows x {seeds} seeds: {trainings} trainings, about {trainings * each:.1f} core hours "
        f"({each:.2f} each, {'measured' if hours else 'expected'})"
    )
    fit = _fit(study, results)
    is_measured = fit is not None and fit.freedom >= LEAST_FREEDOM
    spread = fit.spread if fit is not None and is_measured else SPREAD
    least = detectable(spread, len(rows), seeds)
    if least == math.inf:
        yield "too few rows and seeds to tell differences from chance"
        return
    yield (
        f"a difference of {100 * least:.1f} points between two rows shows four times of five (area under the "
        f"curve; spread {100 * spread:.1f} points, {'measured' if is_measured else 'expected'})"
    )


def _fit(
    study: StudyConfig, results: Sequence[Result], compared: Sequence[str] = (), on: Sequence[str] = ()
) -> Fit | None:
    # What no reward holds wanders more: a difference to a control is held against the controls' spread.
    controls = {name for name, row in study.rows.items() if "webgym.study.controls:" in str(row.settings)}
    pool = controls.union(compared) if controls.intersection(compared) else study.rows.keys() - controls
    results = [each for each in results if each.rates and each.row in pool]
    # A curve is bent: over fewer evaluations its area is smaller, so that those count that both rows have.
    at = set(range(21)).intersection(*(each.places for each in results if each.row in compared))
    areas = {(each.row, each.seed): area for each in results if (area := each.area(on, at)) is not None}
    return Fit(areas) if areas else None


def write(study: StudyConfig, results: Sequence[Result], out: Path) -> None:
    """Write the results so far, their table and their figure."""
    write_whole(out / RESULTS, msgspec.json.format(msgspec.json.encode(results)))
    (out / "study.md").write_text("\n".join([*table(study, results), "", *findings(study, results)]) + "\n")
    if any(result.rates for result in results):
        _draw(results, out / "study.png")


def table(study: StudyConfig, results: Sequence[Result]) -> Iterator[str]:
    """The table in Markdown: mean and standard deviation over seeds, per cent. Before training there is none:
    rows with the same agent share one evaluation."""
    yield "| row | seeds | before | after | area | core hours each | the paper: before, peak, rise |"
    yield "|---|---|---|---|---|---|---|"
    for row, row_results in _by_row(results).items():
        paper = study.rows[row].paper if row in study.rows else None
        paper_cells = f"{paper[0]:.1f}, {paper[1]:.1f}, {paper[1] - paper[0]:+.1f}" if paper else ""
        hours = [result.core_hours for result in row_results if result.core_hours is not None]
        cells = (
            row,
            str(len(row_results)),
            f"{100 * mean(result.before for result in row_results):.1f}",
            _spread([result.last for result in row_results]),
            _spread([area for result in row_results if (area := result.area()) is not None]),
            f"{mean(hours):.2f}" if hours else "",
            paper_cells,
        )
        yield f"| {' | '.join(cells)} |"


def findings(study: StudyConfig, results: Sequence[Result]) -> Iterator[str]:
    """The findings in Markdown, with 95 % intervals of their differences (:class:`Fit`)."""
    yield "| finding | difference of areas, 95 % | repeats? |"
    yield "|---|---|---|"
    for name, finding in study.findings.items():
        fit = _fit(study, results, (finding.better, finding.worse), finding.kinds)
        found = fit.difference(finding.better, finding.worse) if fit is not None else None
        if found is None or found.half_width == math.inf:
            continue
        least, most = 100 * (found.mean - found.half_width), 100 * (found.mean + found.half_width)
        unseen = f"not seen, at most {most:+.1f}"
        verdict = "yes" if least > 0 else "no, the opposite" if most < 0 else unseen
        yield f"| {name} | {100 * found.mean:+.1f} ± {100 * found.half_width:.1f} | {verdict} |"


def _spread(values: Sequence[float]) -> str:
    if not values:
        return ""
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
                linestyle=("-", "--", ":")[number // len(CATEGORIES) % 3],
                label=row,
            )
        axes.set_xlabel("trajectories collected")
        axes.set_ylabel("success on unseen websites, %")
        axes.grid(axis="y")
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
        save(figure, path)


# --- what is more than chance ---------------------------------------------------------------------------
#
# All trainings share their test tasks, and those of a seed their draws as far as the rows' settings allow. So
# a training's result is fitted as an effect of its row plus one of its seed. What remains is the spread that
# every difference of rows is held against, with far more degrees of freedom than two rows have; controls have
# their own.


class Difference(NamedTuple):
    """How much better one row is than another, with half of the 95 % interval; ``inf`` if there is none."""

    mean: float
    half_width: float


class Fit:
    """A fit of results by row and seed.

    Args:
        results: by row and seed; any may be missing.

    Attributes:
        freedom: degrees of freedom of the spread.
        spread: standard deviation of results, apart from what row and seed explain.
    """

    def __init__(self, results: Mapping[tuple[str, int], float]) -> None:
        self._rows = sorted({row for row, _ in results})
        seeds = sorted({seed for _, seed in results})
        columns = [*self._rows, *seeds[1:]]
        design = np.array([[column in key for column in columns] for key in results], dtype=float)
        found = np.array(list(results.values()))
        self._effects, _, rank, _ = np.linalg.lstsq(design, found, rcond=None)
        self._inverse: Any = np.linalg.pinv(design.T @ design)
        rest = found - design @ self._effects
        self.freedom = len(found) - int(rank)
        self.spread = math.sqrt(rest @ rest / self.freedom) if self.freedom else math.nan

    def difference(self, better: str, worse: str) -> Difference | None:
        """Between two rows, of which both must have results; else ``None``."""
        if better not in self._rows or worse not in self._rows:
            return None
        contrast = np.zeros(len(self._effects))
        contrast[self._rows.index(better)], contrast[self._rows.index(worse)] = 1.0, -1.0
        half = math.inf
        if self.freedom >= LEAST_FREEDOM:
            error = self.spread * math.sqrt(contrast @ self._inverse @ contrast)
            half = student(_CONFIDENT, self.freedom) * error
        return Difference(float(contrast @ self._effects), half)


def detectable(spread: float, rows: int, seeds: int) -> float:
    """The smallest difference between two rows that a study of so many rows and seeds finds in four of five
    cases, with the spread of a :class:`Fit`; ``inf`` if none."""
    freedom = (rows - 1) * (seeds - 1)
    if freedom < LEAST_FREEDOM:
        return math.inf
    return (student(_CONFIDENT, freedom) + student(_POWER, freedom)) * spread * math.sqrt(2 / seeds)


def student(share: float, freedom: int) -> float:
    """Quantile of Student's t from the normal distribution's (Abramowitz and Stegun 26.7.5); from two degrees
    of freedom on within 1 %."""
    z = NormalDist().inv_cdf(share)
    terms = (
        (z**3 + z) / 4,
        (5 * z**5 + 16 * z**3 + 3 * z) / 96,
        (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384,
        (79 * z**9 + 776 * z**7 + 1482 * z**5 - 1920 * z**3 - 945 * z) / 92160,
    )
    return z + sum(term / freedom**power for power, term in enumerate(terms, start=1))
