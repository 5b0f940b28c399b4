"""Solve tasks with the scripted policy, and export its steps for LLaMA-Factory.

python llamafactory_data.py FOLDER
cd FOLDER/data && llamafactory-cli train train.yaml
"""

from __future__ import annotations

import asyncio
import subprocess
import sys
from pathlib import Path

import webgym


def main(folder: Path, config: webgym.RunConfig) -> None:
    """A run, and the successes of it."""
    asyncio.run(webgym.collect(config, folder / "run"))
    command = ["export", folder / "run", "--format", "sharegpt", "--out", folder / "data"]
    subprocess.run([sys.executable, "-m", "webgym", *command], check=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), webgym.RunConfig(tasks=webgym.TaskChoice(count=50)))
