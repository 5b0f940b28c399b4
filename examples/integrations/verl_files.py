"""Write what verl reads: two datasets, and the file that names an agent loop for each.

python verl_files.py FOLDER
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from webgym.integrations.verl import write_dataset

AGENT_LOOP = """- name: webgym-{split}
  _target_: webgym.integrations.verl.WebGymAgentLoop
  tasks: {name}
  split: {split}
  size: {size}
"""
OPTIONS = """data.train_files={folder}/train.parquet data.val_files={folder}/test.parquet \\
actor_rollout_ref.rollout.mode=async \\
actor_rollout_ref.rollout.agent.agent_loop_config_path={folder}/agent_loop.yaml"""


def main(folder: Path, name: str = "offline-v2", size: int = 64, count: Any = "all") -> None:
    """And print the options of ``verl.trainer.main_ppo`` that name them."""
    folder.mkdir(parents=True, exist_ok=True)
    loops = ""
    for split in ("train", "test"):
        write_dataset(folder / f"{split}.parquet", name, agent=f"webgym-{split}", split=split, count=count)
        loops += AGENT_LOOP.format(name=name, split=split, size=size)
    (folder / "agent_loop.yaml").write_text(loops)
    print(OPTIONS.format(folder=folder))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
