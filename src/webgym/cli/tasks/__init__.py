"""``webgym tasks``: read and write task sets. A module holds one sub-verb or several of a kind."""

from __future__ import annotations

from typing import Any

import typer
from typer.core import TyperGroup

from webgym.cli._fields import SettingsCommand
from webgym.cli.tasks.check import check, probe, stats, validate
from webgym.cli.tasks.show import show, sources
from webgym.cli.tasks.write import convert, offline, push, sample, split


class _LazyBuild(TyperGroup):
    """Imports ``build`` only when it is called, as its options need the settings of all its stages."""

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name != "build":
            return super().get_command(ctx, cmd_name)
        from webgym.cli.tasks.build import build

        single = typer.Typer(add_completion=False, rich_markup_mode="rich")
        single.command("build", cls=SettingsCommand)(build)
        return typer.main.get_command(single)


app = typer.Typer(cls=_LazyBuild, no_args_is_help=True, help="List, check and write task sets.")


@app.command("build")
def _build() -> None:
    """Build a task set: import, websites, rubrics, decomposition, duplicates, split, statistics."""


for _command in (offline, check, show, convert, sources, split, validate, sample, stats, probe, push):
    app.command()(_command)
