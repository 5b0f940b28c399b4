"""``webgym train``: learn from a policy's own outcomes, iteration after iteration."""

from __future__ import annotations

from pathlib import Path

import typer

from webgym.cli import _options as options


def command(
    config: list[Path] = typer.Argument(
        None, help="Settings (YAML), each laid over those before it; see configs/train/.", show_default=False
    ),
    out: Path | None = typer.Option(None, "--out", help="Folder to make.", show_default=False),
    resume: Path | None = typer.Option(
        None, "--resume", help="Folder to go on with, as it was started.", show_default=False
    ),
    explain: bool = typer.Option(
        False, "--explain", help="Say what an update takes (memory, tokens, time), and do nothing."
    ),
    gpus: str = typer.Option(
        "8xh100", "--gpus", help="For --explain: how many of which, such as 8xh100, 4xa100, 1xh200."
    ),
    token_file: options.TokenFile = None,
) -> None:
    """Train: sample tasks, roll out, judge, learn from what succeeded, publish the weights, evaluate.

    A training that was killed goes on with --resume FOLDER: no attempt is lost and none is made twice.
    """
    from rich.console import Console

    from webgym.cli import _run
    from webgym.core.errors import ConfigError, UsageError

    try:
        import torch  # noqa: F401
    except ImportError as error:
        raise ConfigError("training needs torch", hint="pip install 'webgym-rl[train]'") from error
    from webgym.train.start import open_training, read_config, read_settings_of

    console = Console()
    files = list(config or ())
    if explain:
        settings = read_config(resume) if resume else read_settings_of(files)
        _explain(settings.learn, gpus, console)
        return
    if (out is None) == (resume is None) or bool(files) != bool(out):
        hint = "webgym train CONFIG --out FOLDER makes one, webgym train --resume FOLDER goes on with it"
        raise UsageError("give either settings and --out, or --resume", hint=hint)
    folder = out or resume
    assert folder is not None
    settings = read_config(folder) if resume else read_settings_of(files)
    secrets = _run.secrets(token_file)
    show, tell = _run.show_on(console), _run.tell_on(console)

    async def train() -> None:
        async with open_training(
            settings, folder, resume=resume is not None, secrets=secrets, show=show, tell=tell
        ) as training:
            await training.run()

    _run.run(train)
    console.print(f"\ntraining {folder}", highlight=False, soft_wrap=True)


def _explain(learn: object, gpus: str, console: object) -> None:
    from rich.console import Console

    from webgym.core.errors import UsageError
    from webgym.train.config import LearnConfig
    from webgym.train.estimate import KNOWN_GPUS, estimate

    assert isinstance(learn, LearnConfig)
    assert isinstance(console, Console)
    count, _, kind = gpus.lower().rpartition("x")
    if kind not in KNOWN_GPUS or not (count or "1").isdecimal():
        raise UsageError(
            f"there are no GPUs {gpus!r}", hint=f"such as 8xh100; kinds: {', '.join(KNOWN_GPUS)}"
        )
    known = KNOWN_GPUS[kind].model_copy(update={"count": int(count or 1)})
    console.print(str(estimate(learn, known)), highlight=False)
