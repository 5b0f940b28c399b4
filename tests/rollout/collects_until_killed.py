"""Collects a run, or continues with one, until it is done or killed.

    python collects_until_killed.py RUN CONFIG TORN

CONFIG is a file with the run's settings, as JSON. Of its record number TORN, from 1, half is written, and the
disk answers no more.
"""

from __future__ import annotations

import asyncio
import itertools
import os
import sys
import threading
from pathlib import Path

from benchmarks.stand_ins import TOKEN
from pydantic import SecretStr

from webgym.run.collect import collect, resume
from webgym.run.config import RunConfig, Secrets
from webgym.store.files import CONFIG, TRAJECTORIES, Log


async def main(run: Path, config: Path) -> None:
    secrets = Secrets(server_token=SecretStr(TOKEN))
    if (run / CONFIG).is_file():
        await resume(run, secrets=secrets)
    else:
        await collect(RunConfig.model_validate_json(config.read_bytes()), run, secrets=secrets)


def tear(torn: int) -> None:
    append, numbers = Log.append, itertools.count(1)

    def tears(log: Log, line: bytes, *, durable: bool) -> None:
        if log.path.parent.name == TRAJECTORIES and next(numbers) == torn:
            os.write(log._fd, line[: len(line) // 2])
            threading.Event().wait()
        append(log, line, durable=durable)

    Log.append = tears  # type: ignore[assignment, method-assign]


if __name__ == "__main__":
    tear(int(sys.argv[3]))
    asyncio.run(main(Path(sys.argv[1]), Path(sys.argv[2])))
