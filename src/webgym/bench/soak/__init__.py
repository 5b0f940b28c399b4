"""``webgym bench soak``: a real server under random faults, and whether anything is lost or left afterwards.

plan.py              duration, numbers, and the limits of the server
clients.py           clients that use browsers as agents do, on calm and on hostile pages
dropped_clients.py   clients that disconnect, stop halfway through a request, or keep a connection open
faults.py            faults: processes are killed and stopped, connections broken, the disk filled
target.py            the server under test: a gateway and its workers as separate processes
disk.py              a small disk for the browsers' profiles
leaks.py             what exists before and afterwards
counts.py            counts of sessions, errors and faults, and whether they add up
run.py               the whole benchmark
report.py            progress in the terminal, and tables
"""

from __future__ import annotations

from webgym.bench.soak.counts import Counts
from webgym.bench.soak.plan import SoakPlan
from webgym.bench.soak.report import progress_line, soak_tables
from webgym.bench.soak.run import Soak, soak

__all__ = ["Counts", "Soak", "SoakPlan", "progress_line", "soak", "soak_tables"]
