"""Collects a run, or goes on with one, until it is done or killed.

    python collects_until_killed.py RUN CONFIG

CONFIG is a file with the run's settings, as JSON.
"""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

from pydantic import SecretStr

from webgym.bench.stand_ins import TOKEN
from webgym.collection import RunConfig, Secrets, collect, resume
from webgym.rollout.files import CONFIG


async def main(run: Path, config: Path) -> None:
    secrets = Secrets(server_token=SecretStr(TOKEN))
    if (run / CONFIG).is_file():
        await resume(run, secrets=secrets)
    else:
        await collect(RunConfig.model_validate_json(config.read_bytes()), run, secrets=secrets)


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1]), Path(sys.argv[2])))
