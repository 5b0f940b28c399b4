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
from webgym.judge.config import JudgeChoice
from webgym.rollout.rejudge import RejudgeConfig

if TYPE_CHECKING:
    from rich.console import Console

    from webgym.core.verdict import Cost
    from webgym.llm.prices import Prices
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
            help="OpenAI-compatible endpoint of the rubric judge; its key is read from WEBGYM_JUDGE_API_KEY, "
            "else WEBGYM_API_KEY.",
        ),
        "--model": "rubric.chat.model",
        "--keypoint-model": Option(
            "rubric.keypoint.chat.model", help="Model that selects the screenshots to judge by."
        ),
        "--fact-model": Option("rubric.fact.chat.model", help="Model that judges criterion A."),
        "--response-model": Option("rubric.response.chat.model", help="Model that judges criterion B."),
        "--blocking-model": Option("rubric.blocking.chat.model", help="Model that detects blocked attempts."),
        "--reference-model": Option(
            "rubric.reference.chat.model", help="Model that compares answers with reference answers."
        ),
        "--samples": "panel.samples",
        "--early-exit/--all-facts": "rubric.early_exit",
        "--without-rubric/--with-rubric": "without_rubric",
    },
)
REJUDGE = Options(RejudgeConfig, {"--limit": "limit", "--concurrency": "judges"})


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
    price: str | None = typer.Option(
        None,
        "--price",
        help="Price in dollars per million tokens: PROMPT,COMPLETION or PROMPT,CACHED,COMPLETION.",
        show_default=False,
    ),
    prices: Path | None = typer.Option(
        None, "--prices", help="YAML file of prices by model, instead of --price.", show_default=False
    ),
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
    from webgym.cli._run import run as run_job
    from webgym.core.consent import confirm
    from webgym.core.settings import validated
    from webgym.judge.factory import refuse_unjudgeable
    from webgym.llm.prices import Prices
    from webgym.rollout.rejudge import compare as compare_verdicts
    from webgym.store.files import CONFIG
    from webgym.store.runs import RunReader, verdicts_of

    console = Console()
    reader = RunReader(run)
    if config is None:
        confirm(reader.config, run / CONFIG)
    choice = judge_choice(judge, file=config, default=own_choice(reader.config))
    refuse_unjudgeable(choice, list(RunReader(run, skip_corrupt=True).tasks.values()))
    table = Prices.parse(price) if price else Prices.read(prices) if prices else Prices()
    settings = validated(RejudgeConfig, rejudge | {"again": again})
    state, spent = run_job(
        lambda: _judge(run, choice, settings, table, console), kept="the verdicts so far are stored"
    )
    _print_result(state, spent, console)
    if compare is not None:
        _, verdicts = verdicts_of(run, state.judge)
        other, other_verdicts = verdicts_of(run, compare)
        _print_comparison(state.judge, other, compare_verdicts(verdicts, other_verdicts), console)
    if 0 < sum(state.failures.values()) == state.done - state.earlier:
        raise typer.Exit(1)


app.command("agreement")(agreement_command)


async def _judge(
    run: Path, choice: JudgeChoice, settings: RejudgeConfig, prices: Prices, console: Console
) -> tuple[Judging, Cost]:
    """Judge a run; its state afterwards, and the cost of all calls made now."""
    import msgspec

    from webgym.cli._judge_output import print_costs, progress_bar, spent_since
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
        with watch_clients() as problem, progress_bar(console) as show:
            async with (
                report_problems(problem, print_notes_on(console)),
                open_judge(choice, cache=cache, ledger=ledger) as judge,
            ):
                state = await judge_run(run, judge, settings, show=show)
        if choice.name == "rubric":
            print_costs(ledger, console)
        return state, spent_since(before, ledger.totals.all)


def _print_result(state: Judging, spent: Cost, console: Console) -> None:
    from webgym.cli._judge_output import cost_line, outcomes_line
    from webgym.cli._summary import REASONS, line
    from webgym.results.summary import oracle_notes

    console.print(f"judge      {line(state.judge)}", highlight=False, soft_wrap=True, markup=False)
    unjudged = sum(state.failures.values())
    judged = f"{state.done - unjudged} of {state.total} attempts judged, {state.earlier} of them earlier"
    skipped = f"; {state.skipped} were cut off or belong to another collector" if state.skipped else ""
    console.print(f"judged     {judged}{skipped}", highlight=False, soft_wrap=True)
    if state.left_out:
        records = "1 record" if len(state.left_out) == 1 else f"{len(state.left_out)} records"
        console.print(f"left out   {records} that cannot be judged", highlight=False)
        for why in state.left_out[:REASONS]:
            console.print(f"  {line(why)}", highlight=False, soft_wrap=True, markup=False)
    console.print("outcomes  ", outcomes_line(state))
    for note in oracle_notes(sorted(state.policies)):
        console.print(f"note       {note}", highlight=False, soft_wrap=True)
    for message, count in state.failures.most_common(REASONS):
        console.print(f"  {count} {line(message)}", highlight=False, soft_wrap=True, markup=False)
    console.print(f"cost       {cost_line(state.cost)}", highlight=False, soft_wrap=True)
    if spent.calls > state.spent.calls - state.spent.cached:
        # The costs of attempts without a verdict are in no verdict.
        console.print(f"paid now   {cost_line(spent)}", highlight=False, soft_wrap=True)
    elif state.earlier:
        console.print(f"cost now   {cost_line(state.spent)}", highlight=False, soft_wrap=True)


def _print_comparison(judge: str, other: str, comparison: Any, console: Console) -> None:
    from webgym.cli._summary import line

    both, agreed = comparison.both, comparison.agreed
    share = f"{agreed / both:.1%}" if both else "–"
    console.print()
    console.print(
        f"compared   {line(judge)}\nwith       {line(other)}", highlight=False, soft_wrap=True, markup=False
    )
    console.print(f"agreement  {agreed} of {both} rewards ({share}); {comparison.unjudged} attempts lack one")
    for difference in comparison.differences:
        outcomes = f"{difference.one.outcome} / {difference.other.outcome}"
        console.print(
            f"  {line(difference.attempt_id)}: {outcomes}: {line(difference.why(), 600)}",
            highlight=False,
            soft_wrap=True,
            markup=False,
        )
