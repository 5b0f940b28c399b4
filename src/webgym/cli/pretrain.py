"""``webgym pretrain``: pretrain the initial weights of the tiny policy."""

from __future__ import annotations

from pathlib import Path

import typer

from webgym.cli._fields import Given, Options, takes

RECIPE = Options("webgym.study.recipe:RecipeConfig")


@takes(settings=RECIPE)
def command(
    settings: Given,
    config: list[Path] = typer.Argument(
        None, help="YAML files of settings; see configs/tiny/recipe.yaml.", show_default=False
    ),
    out: Path = typer.Option(
        ..., "--out", help="Folder of the pretraining. An unfinished one in it is continued."
    ),
) -> None:
    """Pretrain the tiny policy: collect demonstrations on training websites, pretrain, evaluate.

    Everything is determined by the seed in the settings. If it is killed, the same command continues from the
    last checkpoint.
    """
    import asyncio
    import time

    import msgspec

    from webgym.cli._checks import check_folder
    from webgym.cli._print import bars, say
    from webgym.cli._run import lasting_console
    from webgym.core.errors import RunFolderError
    from webgym.core.settings import load_settings
    from webgym.store.files import CONFIG, locked, make_folder

    if (out / CONFIG).exists():
        raise RunFolderError(f"{out} holds a run or a training already", hint="choose another folder")
    check_folder(out)
    from webgym.study.recipe import RecipeConfig, follow
    from webgym.train.figures import success_line

    recipe = load_settings(
        RecipeConfig, config or [], hint="see configs/tiny/recipe.yaml", overrides=settings
    )
    make_folder(out)
    console = lasting_console()
    with locked(out), bars(console) as advance, (out / "metrics.jsonl").open("ab") as log:

        def write_metrics(figures: object) -> None:
            assert isinstance(figures, dict)
            log.write(msgspec.json.encode({"at": time.time(), **figures}) + b"\n")  # NaN as null
            log.flush()
            losses = f"loss {figures['pointing']:.2f} pointing, {figures['acting']:.2f} acting"
            advance("pretraining", figures["step"], recipe.pretrain.steps, losses)

        summaries = asyncio.run(follow(recipe, out, tell=write_metrics, advance=advance))
    for split, summary in summaries.items():
        say(f"{split}, {summary['attempts']} attempts: {success_line(summary)}", console)
