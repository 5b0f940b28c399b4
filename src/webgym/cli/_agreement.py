"""``webgym judge agreement``: judges held against people's labels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import typer

from webgym.core.errors import UsageError
from webgym.core.text import plain

if TYPE_CHECKING:
    from rich.console import Console

    from webgym.judge.agreement import Agreement, AgreementConfig, Case, Confusion, Estimate, Group, Metric
    from webgym.judge.labels import AnnotatorAgreement, BrokenLabel, Humans
    from webgym.judge.webjudge import Labelled
    from webgym.tables import Table

_METRICS: Final[dict[Metric, str]] = {
    "accuracy": "accuracy",
    "precision": "precision",
    "recall": "recall",
    "f1": "F1",
    "kappa": "κ",
}


@dataclass(frozen=True)
class _Held:
    """What is measured.

    Attributes:
        judges: names as they are shown.
        cases: of them.
        left_out: why others are not measured.
        notes: what a person should know.
        annotators: how far people agree, where labels say so.
    """

    judges: tuple[str, ...]
    cases: list[Case]
    left_out: Counter[str]
    notes: list[str]
    annotators: AnnotatorAgreement | None = None


def agreement_command(
    run: Path | None = typer.Argument(None, help="The run folder; none with --webjudge.", show_default=False),
    labels: Path | None = typer.Option(
        None,
        "--labels",
        help="People's labels, CSV or JSON; RUN/labels.csv, where the labelling page writes them.",
        show_default=False,
    ),
    judge: list[str] = typer.Option(
        [],
        "--judge",
        help="A judge of the run by its name or how that begins, NAME or NAME=LABEL for the table; may be "
        "given again. `recorded` is the judge of the collection. All judges if not given. The others are "
        "compared with the first.",
        show_default=False,
    ),
    webjudge: list[Path] = typer.Option(
        [],
        "--webjudge",
        help="Instead of a run: replies of the WebJudge study with human labels, JSON lines; may be given "
        "again.",
        show_default=False,
    ),
    annotator: str | None = typer.Option(
        None, "--annotator", help="Only this person's labels.", show_default=False
    ),
    humans: str | None = typer.Option(
        None,
        "--humans",
        help="Whose label counts of several people's: majority, first or unanimous.",
        show_default="majority; first with --webjudge",
    ),
    no_verdict: str | None = typer.Option(
        None,
        "--no-verdict",
        help="What a missing verdict counts: left_out, or failure.",
        show_default="left_out; failure with --webjudge",
    ),
    unsure: str = typer.Option(
        "failure", "--unsure", help="With --webjudge: what an unsure annotator counts, failure or left_out."
    ),
    resamples: int = typer.Option(10_000, "--resamples", min=100, help="Number of bootstrap resamples."),
    seed: int = typer.Option(0, "--seed", help="Seed of the bootstrap."),
    figure: list[Path] = typer.Option(
        [], "--figure", help="Draw it, .png, .svg or .pdf; may be given again.", show_default=False
    ),
    as_json: bool = typer.Option(False, "--json", help="Print everything as JSON."),
    as_markdown: bool = typer.Option(False, "--markdown", help="Print the table as Markdown."),
    as_latex: bool = typer.Option(False, "--latex", help="Print the table as LaTeX (booktabs)."),
) -> None:
    """How far judges agree with people: accuracy, precision, recall, F1 and Cohen's kappa, by difficulty.

    Intervals are 95 % bootstrap intervals over tasks, stratified by difficulty; differences from the first
    judge are paired.
    """
    from rich.console import Console

    from webgym.judge.agreement import agreement
    from webgym.tables import latex, markdown

    if bool(webjudge) == (run is not None):
        raise UsageError("give either a run or --webjudge", hint="see webgym judge agreement --help")
    if as_json + as_markdown + as_latex > 1:
        raise UsageError("give one of --json, --markdown and --latex")
    config = _config(no_verdict or ("failure" if webjudge else "left_out"), resamples, seed)
    if run is None:
        held = _of_replies(webjudge, _humans(humans or "first"), unsure)
    else:
        held = _of_run(run, labels, judge, annotator, _humans(humans or "majority"))
    if not held.cases:
        why = ", ".join(f"{count} × {reason}" for reason, count in held.left_out.items())
        raise UsageError(
            f"there is nothing to measure: {why or 'there are no labels'}",
            hint="label trajectories on the page /label of webgym view RUN, or judge with webgym judge RUN",
        )
    found = agreement(held.judges, held.cases, config)
    for path in figure:
        _draw(found, path)
    console = Console()
    if as_json:
        _print_json(found, held, config)
    elif as_markdown or as_latex:
        for note in _notes(found, held, config):
            Console(stderr=True).print(plain(note), highlight=False, soft_wrap=True, markup=False)
        print((latex if as_latex else markdown)(_tables(found)), end="")
    else:
        _print(found, held, config, console)


def _config(no_verdict: str, resamples: int, seed: int) -> AgreementConfig:
    from webgym.judge.agreement import AgreementConfig

    known: dict[str, Literal["left_out", "failure"]] = {"left_out": "left_out", "failure": "failure"}
    if no_verdict not in known:
        raise UsageError(f"--no-verdict {no_verdict!r} is neither left_out nor failure")
    return AgreementConfig(no_verdict=known[no_verdict], resamples=resamples, seed=seed)


def _humans(name: str) -> Humans:
    known: dict[str, Humans] = {"majority": "majority", "first": "first", "unanimous": "unanimous"}
    if name not in known:
        raise UsageError(f"--humans {name!r} is not one of {', '.join(known)}")
    return known[name]


def _of_run(
    run: Path, labels: Path | None, judges: Sequence[str], annotator: str | None, humans: Humans
) -> _Held:
    from webgym.judge.labels import annotator_agreement, read_labels
    from webgym.rollout.agreement import pairs_of
    from webgym.rollout.labels import labels_path
    from webgym.rollout.rejudge import RECORDED
    from webgym.rollout.verdicts import read_verdicts

    read = read_labels(labels or labels_path(run))
    notes = [f"skipped {broken}" for broken in read.broken]
    said = [label for label in read.labels if annotator in (None, label.annotator)]
    if read.labels and not said:
        known = ", ".join(sorted({label.annotator or "(unnamed)" for label in read.labels}))
        raise UsageError(f"{annotator!r} labelled nothing", hint=f"there are labels of {known}")
    named = dict(_chosen(name) for name in judges)
    chosen = named or dict.fromkeys([RECORDED, *read_verdicts(run)], "")
    pairs = pairs_of(run, list(chosen), said, humans)
    shown = tuple(map(_shown, pairs.judges, chosen.values()))
    if len(set(shown)) < len(shown):
        raise UsageError("two judges have the same name", hint="give them labels: --judge NAME=LABEL")
    return _Held(shown, pairs.cases, pairs.left_out, notes, annotator_agreement(read.labels))


def _chosen(option: str) -> tuple[str, str]:
    """A judge's name and its label. Names hold no ``=``; a label may."""
    name, _, label = option.partition("=")
    return name, label


def _shown(name: str, label: str) -> str:
    """A judge as it is shown. A label does not hide a missing rubric: the figure pairs judges by it."""
    from webgym.judge.without_rubric import PREFIX

    return (PREFIX if label and name.startswith(PREFIX) else "") + (label or name)


def _of_replies(paths: Sequence[Path], humans: Humans, unsure: str) -> _Held:
    from webgym.judge.webjudge import pairs_of, read_labelled

    if unsure not in ("failure", "left_out"):
        raise UsageError(f"--unsure {unsure!r} is neither failure nor left_out")
    records: list[Labelled] = []
    notes: list[str] = []
    for path in paths:
        broken: list[BrokenLabel] = []
        records += read_labelled(path, broken)
        notes += [f"skipped {path} {one}" for one in broken]
    pairs = pairs_of(records, humans, unsure_fails=unsure == "failure")
    notes += [f"read otherwise than recorded: {', '.join(filter(None, key))}" for key in pairs.apart]
    return _Held(pairs.judges, pairs.cases, pairs.left_out, notes)


# --- showing -------------------------------------------------------------------------------------------


def _rows(found: Agreement) -> Iterator[tuple[str, Group, int, int, Mapping[Metric, Estimate]]]:
    """Judge, group, cases that counted, cases without a verdict, metrics."""
    for judge, by_group in found.judges.items():
        for group, figures in by_group.items():
            yield judge, group, figures.confusion.total, figures.no_verdict, figures.metrics


def _differences(found: Agreement) -> Iterator[tuple[str, Group, int, Mapping[Metric, Estimate]]]:
    for one in found.differences:
        for group, cases in one.cases.items():
            yield f"{one.judge} − {one.baseline}", group, cases, one.metrics[group]


def _tables(found: Agreement) -> Iterator[Table]:
    from webgym.tables import Table

    def cell(estimate: Estimate, write: Callable[[float], str]) -> str:
        value, interval = _parts(estimate, write)
        return f"{value} [{interval}]" if interval else value

    columns = ("judge", "difficulty", "n", *_METRICS.values(), "no verdict")
    rows = [
        (judge, group, str(cases), *(cell(metrics[name], _rate) for name in _METRICS), str(missing))
        for judge, group, cases, missing, metrics in _rows(found)
    ]
    yield Table("Agreement with human labels, 95 % bootstrap intervals", columns, rows)
    if found.differences:
        rows = [
            (pair, group, str(cases), *(cell(metrics[name], _signed) for name in _METRICS))
            for pair, group, cases, metrics in _differences(found)
        ]
        yield Table("Paired differences, 95 % bootstrap intervals", columns[:-1], rows)


def _rate(value: float) -> str:
    return f"{value:.3f}"


def _signed(value: float) -> str:
    return f"{value:+.3f}".replace("-", "−")


def _parts(estimate: Estimate, write: Callable[[float], str]) -> tuple[str, str]:
    """A value and its interval; a dash for what is undefined."""
    from webgym.tables import DASH

    if estimate.value is None:
        return DASH, ""
    if estimate.low is None or estimate.high is None:
        return write(estimate.value), ""
    return write(estimate.value), f"{_short(write(estimate.low))}, {_short(write(estimate.high))}"


def _short(figure: str) -> str:
    """``0.467`` as ``.467``: the ends of five intervals must fit into a line."""
    return figure.replace("0.", ".", 1)


def _print(found: Agreement, held: _Held, config: AgreementConfig, console: Console) -> None:
    from rich.table import Table as RichTable

    def block(title: str, rows: Sequence[tuple[Group, str, Mapping[Metric, Estimate]]], signed: bool) -> None:
        console.print()
        console.print(plain(title), style="bold", highlight=False, soft_wrap=True, markup=False)
        table = RichTable(box=None, pad_edge=False, padding=(0, 1 if signed else 2, 0, 0), header_style="dim")
        table.add_column("", no_wrap=True, min_width=len("overall"))
        for name in ("n", *_METRICS.values()):
            table.add_column(name, justify="right", no_wrap=True)
        for group, cases, metrics in rows:
            parts = [_parts(metrics[name], _signed if signed else _rate) for name in _METRICS]
            table.add_row(group, cases, *(value for value, _ in parts))
            table.add_row("", "", *(interval for _, interval in parts), style="dim")
        console.print(table)

    for judge in found.judges:
        rows = [(group, str(n), metrics) for name, group, n, _, metrics in _rows(found) if name == judge]
        missing = found.judges[judge]["overall"].no_verdict
        block(f"{judge}{f'  ({missing} without a verdict)' if missing else ''}", rows, signed=False)
        console.print(_confusion(found.judges[judge]["overall"].confusion), style="dim", highlight=False)
    for one in found.differences:
        rows = [(group, str(n), one.metrics[group]) for group, n in one.cases.items()]
        block(f"{one.judge} − {one.baseline}", rows, signed=True)
    console.print()
    for note in _notes(found, held, config):
        console.print(plain(note), highlight=False, soft_wrap=True, markup=False)


def _confusion(counts: Confusion) -> str:
    return (
        f"success to both {counts.both}, to the judge alone {counts.judge_only}, "
        f"to people alone {counts.human_only}, to neither {counts.neither}"
    )


def _notes(found: Agreement, held: _Held, config: AgreementConfig) -> Iterator[str]:
    labelled = found.cases["overall"]
    yield f"{labelled} labelled trajectories, {found.successes['overall']} of them a success to people"
    counted = "counts as a failure" if config.no_verdict == "failure" else "is left out"
    drawn = f"{config.resamples:,} resamples of tasks, seed {config.seed}"
    yield f"a trajectory without a verdict {counted}; {drawn}"
    for reason, count in sorted(held.left_out.items()):
        yield f"left out: {count} × {reason}"
    people = held.annotators
    if people is not None and people.attempts:
        shared = f"annotators: {people.attempts} shared attempts, the same {people.observed:.1%}"
        yield f"{shared}, Krippendorff's α {_or_undefined(people.alpha)}"
        for pair in people.pairs:
            same = f"{pair.attempts} shared, {pair.observed:.1%} the same"
            yield f"  {' and '.join(pair.pair)}: {same}, κ {_or_undefined(pair.kappa)}"
    yield from held.notes


def _or_undefined(value: float | None) -> str:
    return "undefined" if value is None else _rate(value)


def _print_json(found: Agreement, held: _Held, config: AgreementConfig) -> None:
    import msgspec

    told = {
        **msgspec.to_builtins(found),
        "left_out": dict(held.left_out),
        "annotators": msgspec.to_builtins(held.annotators),
        "notes": held.notes,
        "config": config.model_dump(mode="json"),
    }
    print(msgspec.json.format(msgspec.json.encode(told), indent=2).decode())


def _draw(found: Agreement, path: Path) -> None:
    from webgym.judge.figures import draw_agreement

    draw_agreement(found, path)
