"""``webgym pretrain``: make the tiny policy's first weights."""

from __future__ import annotations

from pathlib import Path

import typer


def command(
    config: list[Path] = typer.Argument(
        None, help="Settings (YAML); see configs/tiny/recipe.yaml.", show_default=False
    ),
    out: Path = typer.Option(..., "--out", help="Folder; an unfinished pretraining in it is continued."),
) -> None:
    """Make the tiny policy's first weights: demonstrations on training websites, pretraining, an examination.

    Everything follows from the settings' seed. Killed, it goes on from its last checkpoint.
    """
    import asyncio
    import json
    import time

    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from webgym.core.errors import ConfigError
    from webgym.rollout.files import make_folder
    from webgym.settings import load_settings

    try:
        import torch  # noqa: F401
    except ImportError as error:
        raise ConfigError("training needs torch", hint="pip install 'webgym-rl[train]'") from error
    from webgym.tiny.recipe import RecipeConfig, follow

    settings = load_settings(RecipeConfig, config or [], hint="see configs/tiny/recipe.yaml")
    make_folder(out)
    console = Console()
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[told]}"),
    )
    with Progress(*columns, console=console) as shown, (out / "metrics.jsonl").open("a") as log:
        bars = {}

        def advance(what: str, done: int, of: int, told: str = "") -> None:
            if what not in bars:
                bars[what] = shown.add_task(what, total=of, told="")
            shown.update(bars[what], completed=done, total=of, told=told)

        def tell(figures: object) -> None:
            assert isinstance(figures, dict)
            print(json.dumps({"at": time.time(), **figures}), file=log, flush=True)
            losses = f"loss {figures['pointing']:.2f} pointing, {figures['acting']:.2f} acting"
            advance("pretraining", figures["step"], settings.pretrain.steps, losses)

        examined = asyncio.run(follow(settings, out, tell=tell, advance=advance))
    for split, said in examined.items():
        for level, interval in said["success_interval"].items():
            if interval is not None:
                (low, high), rate, tried = interval, said["success_rate"][level], said["planned"][level]
                console.print(f"{split} {level}: {rate:.1%} ({low:.1%}-{high:.1%}) of {tried}")
