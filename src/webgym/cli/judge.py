"""``webgym judge``: judge a stored run again, and compare judges.

``webgym judge RUN`` is short for ``webgym judge run RUN``; other sub-verbs have to be named.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import typer
from typer.core import TyperGroup

from webgym.cli._fields import Given, Option, Options, takes
from webgym.cli._options import Price, PriceFile, prices_of
from webgym.cli._print import (
    AsJson,
    AsLatex,
    AsMarkdown,
    bars,
    coloured,
    print_json,
    print_tables,
    refuse_several,
    say,
)
from webgym.core.errors import UsageError
from webgym.core.text import plain
from webgym.judge.agreement import AgreementConfig, agreement, draw_agreement
from webgym.judge.config import MODEL_JUDGES, JudgeChoice
from webgym.judge.labels import Humans
from webgym.rollout.rejudge import RejudgeConfig, compare_judges, judge_run

if TYPE_CHECKING:
    from rich.console import Console

    from webgym.judge.agreement import Agreement, Case
    from webgym.judge.labels import AnnotatorAgreement, BrokenLabel, HumanLabel
    from webgym.judge.webjudge import Labelled
    from webgym.llm.prices import Prices
    from webgym.rollout.rejudge import Judging

Unsure: TypeAlias = Literal["failure", "left_out"]


REPLIES = "replies.sqlite"
"""File of a run's judge replies, in the folder of verdicts, so that no request is paid for twice."""


class _RunFirst(TyperGroup):
    """A command group whose sub-verb ``run`` may be omitted."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] not in ("-h", "--help"):
            args = ["run", *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    cls=_RunFirst,
    no_args_is_help=True,
    help="Judge a stored run again (webgym judge RUN), and compare judges.",
)


@app.callback()
def _group() -> None:
    """Judge a stored run again, and compare judges. `webgym judge RUN` means `webgym judge run RUN`."""


JUDGE = Options(
    JudgeChoice,
    {
        "--judge": Option("name", default="rubric with --base-url, else the run's own"),
        "--base-url": Option(
            "rubric.chat.base_url",
            help="OpenAI-compatible endpoint of the judge's model; its key is read from "
            "WEBGYM_JUDGE_API_KEY, else WEBGYM_API_KEY.",
        ),
        "--model": "rubric.chat.model",
        "--samples": "panel.samples",
        "--without-rubric/--with-rubric": "without_rubric",
    },
)
REJUDGE = Options(RejudgeConfig, {"--limit": "limit"})
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


@app.command("run")
@takes(judge=JUDGE, rejudge=REJUDGE)
def judge_a_run(
    *,
    run: Path = typer.Argument(..., help="The run folder."),
    config: Path | None = typer.Option(
        None, "--config", help="YAML file of the judge's settings; see docs/judge.md.", show_default=False
    ),
    judge: Given,
    rejudge: Given,
    again: bool = typer.Option(
        False, "--again", help="Also judge attempts that this judge has judged before."
    ),
    price: Price = None,
    prices: PriceFile = None,
    compare: str | None = typer.Option(
        None,
        "--compare",
        help="Then compare with another judge of this run: its name or the beginning of it. `recorded` "
        "is the judge that the run was collected with.",
        show_default=False,
    ),
) -> None:
    """Judge every attempt of RUN that this judge has not judged yet, and print outcomes and cost.

    May be stopped at any time and called again: verdicts are stored by the judge's name in RUN/verdicts, and
    no request is made or counted twice. The verdicts of the collection do not change.
    """
    from rich.console import Console

    from webgym.cli._judge_options import judge_choice, own_choice
    from webgym.core.consent import confirm
    from webgym.core.settings import validated
    from webgym.store.files import CONFIG
    from webgym.store.runs import RunReader

    console = Console()
    reader = RunReader(run)
    if config is None:
        confirm(reader.config, run / CONFIG)
    choice = judge_choice(judge, file=config, default=own_choice(reader.config))
    settings = validated(RejudgeConfig, rejudge | {"again": again})
    state = judge_stored(run, choice, settings, prices_of(price, prices), console)
    if compare is not None:
        say(f"\n{compare_judges(run, state.judge, compare)}", console)
    if 0 < sum(state.failures.values()) == state.done - state.earlier:
        raise typer.Exit(1)


def judge_stored(
    run: Path, choice: JudgeChoice, settings: RejudgeConfig, prices: Prices, console: Console
) -> Judging:
    """Judge a stored run, and print outcomes and cost; its state afterwards."""
    from webgym.cli._run import run as run_job
    from webgym.judge.factory import refuse_unjudgeable
    from webgym.store.runs import RunReader

    refuse_unjudgeable(choice, list(RunReader(run, skip_corrupt=True).tasks.values()))
    state = run_job(
        lambda: _judge(run, choice, settings, prices, console), kept="the verdicts so far are stored"
    )
    for line in str(state).splitlines():
        if line.startswith("outcomes"):
            console.print(coloured(line))
        else:
            say(line, console)
    return state


async def _judge(
    run: Path, choice: JudgeChoice, settings: RejudgeConfig, prices: Prices, console: Console
) -> Judging:
    """Judge a run; its state afterwards, with the cost of all calls made now."""
    import msgspec

    from webgym.cli._run import print_notes_on
    from webgym.core.tables import put
    from webgym.core.verdict import Cost
    from webgym.judge.factory import open_judge
    from webgym.llm.cache import ReplyCache
    from webgym.llm.health import report_problems, watch_clients
    from webgym.llm.ledger import Ledger
    from webgym.store.files import VERDICTS, disk_errors

    folder = run / VERDICTS
    with disk_errors(f"making {folder}"):
        folder.mkdir(exist_ok=True)
    async with ReplyCache(folder / REPLIES) as cache:
        ledger = Ledger(cache, prices=prices)
        before = msgspec.structs.replace(ledger.totals.all)

        def show(state: Judging) -> None:
            advance("judging", state.done, state.total, str(state.spent))

        with watch_clients() as problem, bars(console) as advance:
            async with (
                report_problems(problem, print_notes_on(console)),
                open_judge(choice, cache=cache, ledger=ledger) as judge,
            ):
                state = await judge_run(run, judge, settings, show=show)
        if choice.name in MODEL_JUDGES:
            console.print("all calls to judge models for this run:", style="dim", highlight=False)
            put(ledger.table(), console)
        names = ("calls", "prompt_tokens", "completion_tokens", "dollars")
        paid = {name: getattr(ledger.totals.all, name) - getattr(before, name) for name in names}
        state.paid = Cost(**paid)
        return state


# --- agreement with people ---------------------------------------------------------------------------


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


@app.command("agreement")
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
    tables = result.tables() if as_markdown or as_latex else result.blocks()
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
    labels_by_name = dict(option.partition("=")[::2] for option in judges)  # a label may contain it
    labels_by_name = labels_by_name or dict.fromkeys([RECORDED, *read_verdicts(run)], "")
    pairs = pairs_of(run, list(labels_by_name), own, humans, agent=agent)
    names = tuple(map(_printed_name, pairs.judges, labels_by_name.values()))
    if len(set(names)) < len(names):
        raise UsageError("two judges have the same name", hint="give them labels: --judge NAME=LABEL")
    people = annotator_agreement(resolved(reader, read.labels))
    return _Labelled(names, pairs.cases, pairs.left_out, notes, people)


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
        yield from str(people).splitlines()
    yield from labelled.notes


def _document(result: Agreement, labelled: _Labelled, config: AgreementConfig) -> dict[str, object]:
    import msgspec

    return {
        **msgspec.to_builtins(result),
        "left_out": dict(labelled.left_out),
        "annotators": msgspec.to_builtins(labelled.annotators),
        "notes": labelled.notes,
        "config": config.model_dump(mode="json"),
    }
