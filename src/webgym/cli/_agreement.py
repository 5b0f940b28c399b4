"""``webgym judge agreement``: agreement of judges with human labels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal, TypeAlias

import typer

from webgym.cli._fields import Given, Option, Options, takes
from webgym.cli._print import AsJson, AsLatex, AsMarkdown, print_json, print_tables, refuse_several, say
from webgym.core.errors import UsageError
from webgym.core.tables import DASH, Table
from webgym.core.text import plain
from webgym.judge.agreement import AgreementConfig, agreement, draw_agreement
from webgym.judge.labels import Humans

if TYPE_CHECKING:
    from webgym.judge.agreement import Agreement, Case, Confusion, Estimate, Group, Metric
    from webgym.judge.labels import AnnotatorAgreement, BrokenLabel, HumanLabel, Humans
    from webgym.judge.webjudge import Labelled

Unsure: TypeAlias = Literal["failure", "left_out"]

_METRICS: Final[dict[Metric, str]] = {
    "accuracy": "accuracy",
    "precision": "precision",
    "recall": "recall",
    "f1": "F1",
    "kappa": "κ",
}


@dataclass(frozen=True)
class _Labelled:
    """Labelled trajectories with the verdicts of judges.

    Attributes:
        judges: their names, as printed.
        cases: the labels and verdicts to compare.
        left_out: the number of trajectories, or of labels, that are not compared, by reason.
        notes: notes that are printed below the tables.
        annotators: agreement between annotators; ``None`` if the labels do not name them.
    """

    judges: tuple[str, ...]
    cases: list[Case]
    left_out: Counter[str]
    notes: list[str]
    annotators: AnnotatorAgreement | None = None


AGREEMENT = Options(
    AgreementConfig,
    {
        "--no-verdict": Option(
            "no_verdict",
            help="How a trajectory without a verdict is counted: left_out or failure.",
            default="left_out; failure with --webjudge",
        ),
        "--seed": Option("seed", help="Seed of the bootstrap."),
    },
)


@takes(settings=AGREEMENT)
def agreement_command(
    settings: Given,
    run: Path | None = typer.Argument(None, help="The run folder; not with --webjudge.", show_default=False),
    labels: Path | None = typer.Option(
        None,
        "--labels",
        help="File of human labels, CSV or JSON. The labelling page of webgym view writes RUN/labels.csv. "
        "With --webjudge: labels of tasks, for replies without any.",
        show_default="RUN/labels.csv",
    ),
    judge: list[str] = typer.Option(
        [],
        "--judge",
        help="A judge of the run: its name or the beginning of it, and with =LABEL a label for the table. "
        "`recorded` is the judge that the run was collected with. May be repeated; all others are compared "
        "with the first.",
        show_default="all judges",
    ),
    webjudge: list[Path] = typer.Option(
        [],
        "--webjudge",
        help="Instead of a run: JSON lines file of the WebJudge study, with replies and human labels. May be "
        "repeated.",
        show_default=False,
    ),
    annotator: str | None = typer.Option(
        None, "--annotator", help="Use only the labels of this annotator.", show_default=False
    ),
    agent: str | None = typer.Option(
        None,
        "--agent",
        help="In files that name agents, such as Online-Mind2Web's: which one made the run; labels of others "
        "are left out.",
        show_default=False,
    ),
    humans: Humans | None = typer.Option(
        None,
        "--humans",
        help="How labels of several annotators are combined: majority, first or unanimous.",
        show_default="majority; first with --webjudge",
    ),
    unsure: Unsure = typer.Option(
        "failure", "--unsure", help="With --webjudge: how the label 'unsure' is counted: failure or left_out."
    ),
    figure: list[Path] = typer.Option(
        [],
        "--figure",
        help="Draw the agreement to this file: .png, .svg or .pdf. May be repeated.",
        show_default=False,
    ),
    as_json: AsJson = False,
    as_markdown: AsMarkdown = False,
    as_latex: AsLatex = False,
) -> None:
    """Compare judges with human labels: accuracy, precision, recall, F1 and Cohen's kappa, by difficulty.

    Intervals are 95 % bootstrap intervals over tasks, stratified by difficulty; differences from the first
    judge are paired.
    """
    from rich.console import Console

    from webgym.cli._checks import check_figure
    from webgym.core.settings import validated

    if bool(webjudge) == (run is not None):
        raise UsageError("give either a run folder or --webjudge", hint="see webgym judge agreement --help")
    refuse_several(json=as_json, markdown=as_markdown, latex=as_latex)
    for path in figure:
        check_figure(path)
    combined: Humans = humans or ("majority" if run else "first")
    config = validated(AgreementConfig, {"no_verdict": "failure" if webjudge else "left_out"} | settings)
    if run is None:
        own = _labels_of_tasks(labels, annotator, agent) if labels else []
        labelled = _read_webjudge(webjudge, own, combined, unsure)
    else:
        labelled = _read_run(run, labels, judge, annotator, agent, combined)
    if not labelled.cases:
        left_out = [f"{count} × {reason}" for reason, count in labelled.left_out.items()]
        why = ", ".join(left_out or labelled.notes[:1]) or "there are no labels"
        raise UsageError(
            f"no labelled trajectory has a verdict: {why}",
            hint="label trajectories on the page /label of webgym view RUN, or judge with webgym judge RUN",
        )
    result = agreement(labelled.judges, labelled.cases, config)
    for path in figure:
        draw_agreement(result, path)
    if as_json:
        print_json(_document(result, labelled, config))
        return
    console = Console(stderr=as_markdown or as_latex)
    tables = _tables(result) if as_markdown or as_latex else _blocks(result)
    print_tables(tables, console, as_markdown=as_markdown, as_latex=as_latex)
    for note in _notes(result, labelled, config):
        say(plain(note), console)


def _read_run(
    run: Path,
    labels: Path | None,
    judges: Sequence[str],
    annotator: str | None,
    agent: str | None,
    humans: Humans,
) -> _Labelled:
    from webgym.judge.labels import annotator_agreement, read_labels
    from webgym.results.labels import labels_path, pairs_of, resolved
    from webgym.store.runs import RECORDED, RunReader
    from webgym.store.verdicts import read_verdicts

    reader = RunReader(run, skip_corrupt=True)
    read = read_labels(labels or labels_path(run))
    notes = [f"skipped {broken}" for broken in read.broken]
    own = [label for label in read.labels if annotator in (None, label.annotator)]
    if read.labels and not own:
        known = ", ".join(sorted({label.annotator or "(unnamed)" for label in read.labels}))
        raise UsageError(f"there are no labels of {annotator!r}", hint=f"the annotators are {known}")
    labels_by_name = dict(_name_and_label(option) for option in judges)
    labels_by_name = labels_by_name or dict.fromkeys([RECORDED, *read_verdicts(run)], "")
    pairs = pairs_of(run, list(labels_by_name), own, humans, agent=agent)
    names = tuple(map(_printed_name, pairs.judges, labels_by_name.values()))
    if len(set(names)) < len(names):
        raise UsageError("two judges have the same name", hint="give them labels: --judge NAME=LABEL")
    people = annotator_agreement(resolved(reader, read.labels))
    return _Labelled(names, pairs.cases, pairs.left_out, notes, people)


def _name_and_label(option: str) -> tuple[str, str]:
    """Split ``NAME=LABEL``; a label may contain ``=``, a judge's name does not."""
    name, _, label = option.partition("=")
    return name, label


def _printed_name(name: str, label: str) -> str:
    """A judge's name in tables. The prefix for a missing rubric stays: the figure pairs judges by it."""
    from webgym.judge.panel import PREFIX

    return (PREFIX if label and name.startswith(PREFIX) else "") + (label or name)


def _labels_of_tasks(path: Path, annotator: str | None, agent: str | None) -> list[HumanLabel]:
    """The labels of tasks in a file, of one annotator if one is given, and of one agent's run."""
    from webgym.judge.labels import read_labels

    labels = [label for label in read_labels(path).labels if annotator in (None, label.annotator)]
    agents = sorted({label.agent for label in labels if label.agent})
    if agent is None and len(agents) > 1:
        raise UsageError(
            f"{path} has labels of several agents", hint=f"--agent is one of {', '.join(agents)}"
        )
    whose = ("", agent or "".join(agents))
    return [label for label in labels if label.task_id and label.agent in whose]


def _read_webjudge(
    paths: Sequence[Path], labels: Sequence[HumanLabel], humans: Humans, unsure: str
) -> _Labelled:
    from webgym.judge.webjudge import pairs_of, read_labelled

    records: list[Labelled] = []
    notes: list[str] = []
    for path in paths:
        broken: list[BrokenLabel] = []
        records += read_labelled(path, broken, labels)
        notes += [f"skipped {path} {label}" for label in broken]
    pairs = pairs_of(records, humans, unsure_fails=unsure == "failure")
    notes += [
        f"our reading of the reply differs from the recorded verdict: {', '.join(filter(None, key))}"
        for key in pairs.apart
    ]
    return _Labelled(pairs.judges, pairs.cases, pairs.left_out, notes)


def _rows(result: Agreement) -> Iterator[tuple[str, Group, int, int, Mapping[Metric, Estimate]]]:
    """Judge, difficulty, number of cases that count, number without a verdict, metrics."""
    for judge, by_group in result.judges.items():
        for group, figures in by_group.items():
            yield judge, group, figures.confusion.total, figures.no_verdict, figures.metrics


def _differences(result: Agreement) -> Iterator[tuple[str, Group, int, Mapping[Metric, Estimate]]]:
    """Pair of judges, difficulty, number of cases, differences of metrics."""
    for difference in result.differences:
        for group, cases in difference.cases.items():
            yield f"{difference.judge} − {difference.baseline}", group, cases, difference.metrics[group]


def _tables(result: Agreement) -> Iterator[Table]:
    def cell(estimate: Estimate, write: Callable[[float], str]) -> str:
        value, interval = _parts(estimate, write)
        return f"{value} [{interval}]" if interval else value

    columns = ("judge", "difficulty", "n", *_METRICS.values(), "no verdict")
    rows = [
        (judge, group, str(cases), *(cell(metrics[name], _rate) for name in _METRICS), str(missing))
        for judge, group, cases, missing, metrics in _rows(result)
    ]
    yield Table("Agreement with human labels, 95 % bootstrap intervals", columns, rows)
    if result.differences:
        rows = [
            (pair, group, str(cases), *(cell(metrics[name], _signed) for name in _METRICS))
            for pair, group, cases, metrics in _differences(result)
        ]
        yield Table("Paired differences, 95 % bootstrap intervals", columns[:-1], rows)


def _rate(value: float) -> str:
    return f"{value:.3f}"


def _signed(value: float) -> str:
    return f"{value:+.3f}".replace("-", "−")


def _parts(estimate: Estimate, write: Callable[[float], str]) -> tuple[str, str]:
    """A value and its interval as text; a dash if the value is undefined."""
    if estimate.value is None:
        return DASH, ""
    if estimate.low is None or estimate.high is None:
        return write(estimate.value), ""
    return write(estimate.value), f"{_short(write(estimate.low))}, {_short(write(estimate.high))}"


def _short(figure: str) -> str:
    """Write ``0.467`` as ``.467``, so that five intervals fit on a line."""
    return figure.replace("0.", ".", 1)


def _blocks(result: Agreement) -> Iterator[Table]:
    """A table for each judge and each difference, narrow enough for a terminal: intervals below values."""
    for judge in result.judges:
        rows = [(group, n, metrics) for name, group, n, _, metrics in _rows(result) if name == judge]
        overall = result.judges[judge]["overall"]
        missing = f"  ({overall.no_verdict} without a verdict)" if overall.no_verdict else ""
        yield _block(f"{judge}{missing}: {_confusion(overall.confusion)}", rows, _rate)
    for difference in result.differences:
        rows = [(group, n, difference.metrics[group]) for group, n in difference.cases.items()]
        yield _block(f"{difference.judge} − {difference.baseline}", rows, _signed)


def _block(
    title: str,
    rows: Sequence[tuple[Group, int, Mapping[Metric, Estimate]]],
    write: Callable[[float], str],
) -> Table:
    cells: list[tuple[str, ...]] = []
    for group, count, metrics in rows:
        values, intervals = zip(*(_parts(metrics[name], write) for name in _METRICS), strict=True)
        cells += [(group, str(count), *values), ("", "", *intervals)]
    return Table(title, ("", "n", *_METRICS.values()), cells)


def _confusion(counts: Confusion) -> str:
    return (
        f"judged a success by both {counts.both}, by the judge only {counts.judge_only}, "
        f"by people only {counts.human_only}, by neither {counts.neither}"
    )


def _notes(result: Agreement, labelled: _Labelled, config: AgreementConfig) -> Iterator[str]:
    count, successes = result.cases["overall"], result.successes["overall"]
    left_out = labelled.left_out.items()  # trajectories, and labels that are of none or were given again
    given = count + sum(number for reason, number in left_out if not reason.startswith("a label "))
    yield f"{count} of {given} labelled trajectories compared, {successes} of them labelled as successes"
    counted = "counts as a failure" if config.no_verdict == "failure" else "is left out"
    resamples = f"{config.resamples:,} bootstrap resamples of tasks, seed {config.seed}"
    yield f"a trajectory without a verdict {counted}; {resamples}"
    for reason, count in sorted(left_out):
        yield f"left out: {count} × {reason}"
    people = labelled.annotators
    if people is not None and people.attempts:
        shared = f"annotators: {people.attempts} shared attempts, {people.observed:.1%} labelled the same"
        yield f"{shared}, Krippendorff's α {_or_undefined(people.alpha)}"
        for pair in people.pairs:
            same = f"{pair.attempts} shared, {pair.observed:.1%} labelled the same"
            yield f"  {' and '.join(pair.pair)}: {same}, κ {_or_undefined(pair.kappa)}"
    yield from labelled.notes


def _or_undefined(value: float | None) -> str:
    return "undefined" if value is None else _rate(value)


def _document(result: Agreement, labelled: _Labelled, config: AgreementConfig) -> dict[str, object]:
    import msgspec

    return {
        **msgspec.to_builtins(result),
        "left_out": dict(labelled.left_out),
        "annotators": msgspec.to_builtins(labelled.annotators),
        "notes": labelled.notes,
        "config": config.model_dump(mode="json"),
    }
