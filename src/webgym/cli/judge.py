"""``webgym judge``: judge a stored run again, and compare judges.

``webgym judge RUN`` is short for ``webgym judge run RUN``; other sub-verbs have to be named.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer.core import TyperGroup

from webgym.cli._agreement import agreement_command
from webgym.cli._fields import Given, Option, Options, takes
from webgym.cli._options import Price, PriceFile, prices_of
from webgym.judge.config import MODEL_JUDGES, JudgeChoice
from webgym.rollout.rejudge import RejudgeConfig

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

    from webgym.core.verdict import Cost
    from webgym.llm.ledger import Ledger
    from webgym.llm.prices import Prices, Usage
    from webgym.rollout.rejudge import Judging


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
        _print_comparison(run, state.judge, compare, console)
    if 0 < sum(state.failures.values()) == state.done - state.earlier:
        raise typer.Exit(1)


app.command("agreement")(agreement_command)


def judge_stored(
    run: Path, choice: JudgeChoice, settings: RejudgeConfig, prices: Prices, console: Console
) -> Judging:
    """Judge a stored run, and print outcomes and cost; its state afterwards."""
    from webgym.cli._run import run as run_job
    from webgym.judge.factory import refuse_unjudgeable
    from webgym.store.runs import RunReader

    refuse_unjudgeable(choice, list(RunReader(run, skip_corrupt=True).tasks.values()))
    state, spent = run_job(
        lambda: _judge(run, choice, settings, prices, console), kept="the verdicts so far are stored"
    )
    _print_result(state, spent, console)
    return state


async def _judge(
    run: Path, choice: JudgeChoice, settings: RejudgeConfig, prices: Prices, console: Console
) -> tuple[Judging, Cost]:
    """Judge a run; its state afterwards, and the cost of all calls made now."""
    import msgspec

    from webgym.cli._print import bars
    from webgym.cli._run import print_notes_on
    from webgym.judge.factory import open_judge
    from webgym.llm.cache import ReplyCache
    from webgym.llm.health import report_problems, watch_clients
    from webgym.llm.ledger import Ledger
    from webgym.rollout.rejudge import judge_run
    from webgym.store.files import VERDICTS, disk_errors

    folder = run / VERDICTS
    with disk_errors(f"making {folder}"):
        folder.mkdir(exist_ok=True)
    async with ReplyCache(folder / REPLIES) as cache:
        ledger = Ledger(cache, prices=prices)
        before = msgspec.structs.replace(ledger.totals.all)

        def show(state: Judging) -> None:
            advance("judging", state.done, state.total, _cost_line(state.spent))

        with watch_clients() as problem, bars(console) as advance:
            async with (
                report_problems(problem, print_notes_on(console)),
                open_judge(choice, cache=cache, ledger=ledger) as judge,
            ):
                state = await judge_run(run, judge, settings, show=show)
        if choice.name in MODEL_JUDGES:
            _print_costs(ledger, console)
        return state, _spent_since(before, ledger.totals.all)


def _print_result(state: Judging, spent: Cost, console: Console) -> None:
    from webgym.cli._print import counted, say, shortened
    from webgym.cli._summary import REASONS
    from webgym.results.summary import oracle_notes

    say(f"judge      {shortened(state.judge)}", console)
    unjudged = sum(state.failures.values())
    judged = f"{state.done - unjudged} of {state.total} attempts judged, {state.earlier} of them earlier"
    skipped = f"; {state.skipped} were cut off or belong to another collector" if state.skipped else ""
    say(f"judged     {judged}{skipped}", console)
    if state.left_out:
        say(f"left out   {counted(len(state.left_out), 'record')} that cannot be judged", console)
        for why in state.left_out[:REASONS]:
            say(f"  {shortened(why)}", console)
    console.print("outcomes  ", _outcomes_line(state))
    for note in oracle_notes(sorted(state.policies)):
        say(f"note       {note}", console)
    for message, count in state.failures.most_common(REASONS):
        say(f"  {count} {shortened(message)}", console)
    say(f"cost       {_cost_line(state.cost)}", console)
    if spent.calls > state.spent.calls - state.spent.cached:
        # The costs of attempts without a verdict are in no verdict.
        say(f"paid now   {_cost_line(spent)}", console)
    elif state.earlier:
        say(f"cost now   {_cost_line(state.spent)}", console)


def _print_comparison(run: Path, judge: str, selector: str, console: Console) -> None:
    """Compare a judge's verdicts with those of another judge of the run, and print differences."""
    from webgym.cli._print import say, shortened
    from webgym.rollout.rejudge import compare
    from webgym.store.runs import verdicts_of

    other, other_verdicts = verdicts_of(run, selector)
    comparison = compare(verdicts_of(run, judge)[1], other_verdicts)
    both, agreed = comparison.both, comparison.agreed
    share = f"{agreed / both:.1%}" if both else "–"
    say(f"\ncompared   {shortened(judge)}\nwith       {shortened(other)}", console)
    say(f"agreement  {agreed} of {both} rewards ({share}); {comparison.unjudged} attempts lack one", console)
    for difference in comparison.differences:
        outcomes = f"{difference.one.outcome} / {difference.other.outcome}"
        why = shortened(difference.why(), 600)
        say(f"  {shortened(difference.attempt_id)}: {outcomes}: {why}", console)


def _outcomes_line(state: Judging) -> Text:
    """The number of attempts by outcome, on one line."""
    from rich.text import Text

    from webgym.core.outcome import Outcome
    from webgym.rollout.live import COLORS

    line = Text()
    for outcome in Outcome:
        if count := state.outcomes[outcome]:
            line.append(f"{count} ", style="bold")
            line.append(f"{outcome}   ", style=COLORS[outcome])
    return line


def _cost_line(cost: Cost) -> str:
    """The number of model calls, their tokens and their price, on one line."""
    if not cost.calls:
        return "no model was called"
    parts = [f"{cost.calls:,} replies"]
    if cost.cached:
        parts.append(f"{cost.cached:,} from the cache")
    if cost.repeats:
        parts.append(f"{cost.repeats:,} repeated")
    parts.append(f"{cost.prompt_tokens:,} + {cost.completion_tokens:,} tokens")
    parts.append(f"${cost.dollars:.4f}" if cost.dollars else "price unknown")
    return ", ".join(parts)


def _print_costs(ledger: Ledger, console: Console) -> None:
    """Print the cost of every stage and model, including earlier calls of ``webgym judge`` for the run."""
    from webgym.core.tables import Table, put

    columns = ("stage", "model", "paid", "cached", "prompt tokens", "reply tokens", "dollars")
    rows = [
        (
            purpose,
            model,
            *map(str, (usage.calls, usage.hits, usage.prompt_tokens, usage.completion_tokens)),
            "unknown" if usage.unpriced else f"{usage.dollars:.4f}",
        )
        for (purpose, model), usage in sorted(ledger.rows.items())
    ]
    console.print("all calls to judge models for this run:", style="dim", highlight=False)
    put(Table("", columns, rows, names=2), console)


def _spent_since(before: Usage, now: Usage) -> Cost:
    """The cost of all calls between two states of a ledger, whether or not they led to a verdict."""
    from webgym.core.verdict import Cost

    return Cost(
        calls=now.calls - before.calls,
        prompt_tokens=now.prompt_tokens - before.prompt_tokens,
        completion_tokens=now.completion_tokens - before.completion_tokens,
        dollars=now.dollars - before.dollars,
    )
