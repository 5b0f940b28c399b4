"""Write the prompts for slime, and print the flags with which they are played in browsers.

python slime_prompts.py prompts.jsonl
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import webgym

FLAGS = """--prompt-data {path} --input-key prompt --metadata-key metadata \\
--custom-generate-function-path webgym.integrations.slime.generate \\
--dynamic-sampling-filter-path webgym.integrations.slime.has_rewards"""


def main(path: str, name: str = "offline-v2", **given: Any) -> None:
    """A line for each task; ``WEBGYM_TASKS`` has to name the same tasks where slime runs."""
    rows = webgym.task_rows(name, **{"count": "all", **given})
    lines = [{"prompt": row["instruction"], "metadata": {"task_id": row["task_id"]}} for row in rows]
    Path(path).write_text("".join(json.dumps(line) + "\n" for line in lines))
    print(FLAGS.format(path=path))


if __name__ == "__main__":
    main(sys.argv[1])
