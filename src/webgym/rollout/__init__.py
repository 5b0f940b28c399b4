"""From tasks to judged trajectories on disk.

plan.py       which attempts are still to be made
driver.py     the environment's side of an attempt: browser, observations, who caused its end
attempt.py    one attempt: observe, ask, act, until it ends
collector.py  many attempts at once, then judging and recording (config.py: its settings)
sessions.py   waiting for a server that is away
sharing.py    one task list for several collectors (merging.py: their runs as one)
progress.py   what is going on right now (live.py: in a terminal; live_file.py: for other processes)
judging.py    one episode judged, whatever the judge does; stored ones judged again
rejudge.py    a stored run judged by another judge, and judges compared
site_health.py  which websites answer
"""
