"""From tasks to judged trajectories on disk.

plan.py       which attempts are still to be made
attempt.py    one attempt: observe, ask, act, until it ends
collector.py  many attempts at once, then judging and recording
progress.py   what is going on right now
live.py       the same for a terminal
store.py      the run folder (records.py: one line of it)
summary.py    the figures of a run
"""
