"""Write what verl reads: two datasets, and the file that names the agent loop.

python verl_files.py FOLDER
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from webgym.integrations.verl import write_dataset

AGENT_LOOP = """- name: webgym
  _target_: webgym.integrations.verl.WebGymAgentLoop
  tasks: {name}
  size: {size}
"""
OPTIONS = """data.train_files={folder}/train.parquet data.val_files={folder}/test.parquet \\
actor_rollout_ref.rollout.mode=async \\
actor_rollout_ref.rollout.agent.agent_loop_config_path={folder}/agent_loop.yaml"""


def main(folder: Path, name: str = "offline-v1", size: int = 64, count: Any = "all") -> None:
    """And print the options of ``verl.trainer.main_ppo`` that name them."""
    folder.mkdir(parents=True, exist_ok=True)
    for split in ("train", "test"):
        write_dataset(folder / f"{split}.parquet", name, split=split, count=count)
    (folder / "agent_loop.yaml").write_text(AGENT_LOOP.format(name=name, size=size))
    print(OPTIONS.format(folder=folder))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
