"""Reports and viewers. They read the run store and task sets, nothing else.

write.py       report.html, one file that needs no network
live.py        the same pages over a run that may still be written; live_run.py, the run
labelling.py   the page where people label its trajectories
taskset.py     the pages of a task set
serving.py     how both are served
training.py    the report of a training and its curves
run_index.py   the index of a run's trajectories, in SQLite
content.py     trajectories as the pages need them
overview.py    the figures and charts of a run, as HTML
charts.py      inline SVG
thumbnails.py  small pictures for the file
template.py    the page around it all: templates/ and static/
"""
