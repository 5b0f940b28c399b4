"""From tasks to judged trajectories on disk.

plan.py       which attempts are still to be made
attempt.py    one attempt: observe, ask, act, until it ends
collector.py  many attempts at once, then judging and recording (config.py: its settings)
sharing.py    one task list for several collectors (merging.py: their runs as one)
progress.py   what is going on right now
live.py       the same for a terminal
judging.py    one episode judged, whatever the judge does; what is left to judge when a run is resumed
rejudge.py    a stored run judged again (verdicts.py: where that is kept)
blocklist.py  websites that kept the agent out
store.py      the run folder (records.py: one line of it)
summary.py    the figures of a run
"""
