"""``webgym report``: write the report of a run or of a training."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from webgym.cli._fields import Given, Options, takes
from webgym.cli._print import bars
from webgym.core.settings import validated
from webgym.report.config import ReportConfig
from webgym.report.training import write_training_report
from webgym.report.write import write_report
from webgym.store.files import is_training

REPORT = Options(ReportConfig, {"--embed/--no-embed": "embed", "--width": "image_width"})


@takes(settings=REPORT)
def command(
    run: Annotated[Path, typer.Argument(help="Folder of a run or of a training.")], settings: Given
) -> None:
    """Write RUN/report.html, which needs no network access, and print its path."""
    config = validated(ReportConfig, settings)
    write = write_training_report if is_training(run) else write_report
    with bars() as advance:
        path = write(run, config=config, progress=advance)
    print(path)
