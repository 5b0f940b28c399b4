"""The agent server of NeMo Gym, and its dataset.

python nemo_gym_agent.py rows.jsonl   # writes the rows
python nemo_gym_agent.py              # the server: ``entrypoint`` in a configuration of NeMo Gym's
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from webgym.integrations.nemo_gym import WebGymAgent, nemo_gym_rows


def main(path: str, name: str = "offline-v2", **given: Any) -> None:
    """A line for each task."""
    rows = nemo_gym_rows(name, **{"count": "all", **given})
    Path(path).write_text("".join(json.dumps(row) + "\n" for row in rows))


if __name__ == "__main__":
    if sys.argv[1:]:
        main(sys.argv[1])
    else:
        WebGymAgent.run_webserver()
