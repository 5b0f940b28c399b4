"""A digest of every website's tasks, of some websites of each family: what a version of the web means.

``PYTHONPATH=src python tests/offline/golden.py > tests/offline/golden.txt`` after a change that is meant to
change tasks; the difference then shows on which websites. Names that were published keep theirs.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

from webgym.environment import COLLECTIONS
from webgym.offline.web import OfflineWeb

PER_FAMILY = 3


def lines() -> Iterator[str]:
    """Name of the version, host, number of tasks, and a digest of their ids, instructions and truths."""
    for name, collection in COLLECTIONS.items():
        web = OfflineWeb(per_family=PER_FAMILY, collection=collection)
        for host, spec in web.specs.items():
            tasks = list(web.tasks_of(host))
            said = "\n".join(f"{task.id}\t{task.instruction}\t{task.truth}" for task in tasks)
            yield f"{name} {spec.split} {host} {len(tasks)} {hashlib.sha256(said.encode()).hexdigest()[:16]}"


if __name__ == "__main__":
    print("\n".join(lines()))
