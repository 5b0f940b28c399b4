"""``webgym judge``: judge a stored run again, and compare judges.

``webgym judge RUN`` is ``webgym judge run RUN``; further sub-verbs are commands beside it.
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
    from webgym.rollout.rejudge import Judging


REPLIES = "replies.sqlite"
"""Where a run's judge replies are kept, beside the verdicts: a question is paid for once."""


class _RunFirst(TyperGroup):
    """A group whose command ``run`` may be left out."""

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
    """Judge a stored run again, and compare judges: `webgym judge RUN` is `webgym judge run RUN`."""


JUDGE = Options(
    JudgeChoice,
    {
        "--judge": Option("name", default="rubric with --base-url, else the run's own"),
        "--base-url": Option(
            "rubric.chat.base_url",
            help="OpenAI-compatible endpoint of the rubric judge; its key: WEBGYM_JUDGE_API_KEY, else "
            "WEBGYM_API_KEY.",
        ),
        "--model": "rubric.chat.model",
        "--keypoint-model": Option("rubric.keypoint.chat.model", help="Model that chooses screenshots."),
        "--fact-model": Option("rubric.fact.chat.model", help="Model that judges criterion A."),
        "--response-model": Option("rubric.response.chat.model", help="Model that judges criterion B."),
        "--blocking-model": Option("rubric.blocking.chat.model", help="Model that recognises blocking."),
        "--reference-model": Option(
            "rubric.reference.chat.model", help="Model that compares with reference answers."
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
    again: bool = typer.Option(False, "--again", help="Judge again what this judge has judged before."),
    price: str | None = typer.Option(
        None,
        "--price",
        help="PROMPT,COMPLETION or PROMPT,CACHED,COMPLETION: dollars per million tokens.",
        show_default=False,
    ),
    prices: Path | None = typer.Option(
        None, "--prices", help="YAML file of prices by model.", show_default=False
    ),
    compare: str | None = typer.Option(
        None,
        "--compare",
        help="Then compare with another judge of this run, by its name or how that begins; `recorded` is "
        "the verdict of the collection.",
        show_default=False,
    ),
) -> None:
    """Judge every attempt of RUN that this judge has not judged yet, and show outcomes and cost.

    May be stopped at any time and called again: verdicts are kept by the judge's name in RUN/verdicts, and
    nothing is asked or counted twice. The run's own verdicts do not change.
    """
    import msgspec
    from rich.console import Console

    from webgym.cli._judge_options import judge_choice, own_choice
    from webgym.cli._judge_output import print_account, showing, spent_since
    from webgym.cli._run import print_notes_on
    from webgym.cli._run import run as run_job
    from webgym.judge.factory import open_judge, refuse_unjudgeable
    from webgym.llm.cache import ReplyCache
    from webgym.llm.health import report_problems, watch_clients
    from webgym.llm.ledger import Ledger
    from webgym.llm.prices import Prices
    from webgym.rollout.files import VERDICTS, disk_errors
    from webgym.rollout.rejudge import compare as compare_verdicts
    from webgym.rollout.rejudge import judge_run, verdicts_of
    from webgym.rollout.store import RunReader
    from webgym.settings import validated

    console = Console()
    choice = judge_choice(judge, file=config, default=own_choice(RunReader(run).config))
    refuse_unjudgeable(choice, list(RunReader(run, skip_corrupt=True).tasks.values()))
    known = Prices.parse(price) if price else Prices.read(prices) if prices else Prices()
    settings = validated(RejudgeConfig, rejudge | {"again": again})

    async def job() -> tuple[Judging, Cost]:
        folder = run / VERDICTS
        with disk_errors(f"making {folder}"):
            folder.mkdir(exist_ok=True)
        async with ReplyCache(folder / REPLIES) as cache:
            ledger = Ledger(cache, prices=known)
            before = msgspec.structs.replace(ledger.totals.all)
            with watch_clients() as problem, showing(console) as show:
                async with (
                    report_problems(problem, print_notes_on(console)),
                    open_judge(choice, cache=cache, ledger=ledger) as opened,
                ):
                    state = await judge_run(run, opened, settings, show=show)
            if choice.name == "rubric":
                print_account(ledger, console)
            return state, spent_since(before, ledger.totals.all)

    state, spent = run_job(job)
    _print(state, spent, console)
    if compare is not None:
        _, mine = verdicts_of(run, state.judge)
        name, theirs = verdicts_of(run, compare)
        _print_comparison(state.judge, name, compare_verdicts(mine, theirs), console)
    if 0 < sum(state.failures.values()) == state.done:
        raise typer.Exit(1)


app.command("agreement")(agreement_command)


def _print(state: Judging, spent: Cost, console: Console) -> None:
    from webgym.cli._judge_output import cost_line, outcomes_line
    from webgym.cli._summary import REASONS, line

    console.print(f"judge      {line(state.judge)}", highlight=False, soft_wrap=True, markup=False)
    unjudged = sum(state.failures.values())
    told = f"{state.done - unjudged} of {state.total} attempts judged, {state.earlier} of them earlier"
    skipped = f"; {state.skipped} did not end of their own" if state.skipped else ""
    console.print(f"judged     {told}{skipped}", highlight=False, soft_wrap=True)
    if state.left_out:
        records = "1 record" if len(state.left_out) == 1 else f"{len(state.left_out)} records"
        console.print(f"left out   {records} that cannot be judged", highlight=False)
        for why in state.left_out[:REASONS]:
            console.print(f"  {line(why)}", highlight=False, soft_wrap=True, markup=False)
    console.print("outcomes  ", outcomes_line(state))
    for message, count in state.failures.most_common(REASONS):
        console.print(f"  {count} {line(message)}", highlight=False, soft_wrap=True, markup=False)
    console.print(f"cost       {cost_line(state.cost)}", highlight=False, soft_wrap=True)
    if spent.calls > state.spent.calls - state.spent.cached:
        # What was paid for attempts that have no verdict stands in none.
        console.print(f"paid now   {cost_line(spent)}", highlight=False, soft_wrap=True)
    elif state.earlier:
        console.print(f"cost now   {cost_line(state.spent)}", highlight=False, soft_wrap=True)


def _print_comparison(one: str, other: str, comparison: Any, console: Console) -> None:
    from webgym.cli._summary import line

    both, agreed = comparison.both, comparison.agreed
    share = f"{agreed / both:.1%}" if both else "–"
    console.print()
    console.print(
        f"compared   {line(one)}\nwith       {line(other)}", highlight=False, soft_wrap=True, markup=False
    )
    console.print(
        f"agreement  {agreed} of {both} rewards ({share}); {comparison.unjudged} without two rewards"
    )
    for difference in comparison.differences:
        outcomes = f"{difference.one.outcome} / {difference.other.outcome}"
        console.print(
            f"  {line(difference.attempt_id)}: {outcomes}: {line(difference.why(), 600)}",
            highlight=False,
            soft_wrap=True,
            markup=False,
        )
