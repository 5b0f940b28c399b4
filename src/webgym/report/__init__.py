"""Reports and viewers. They read the run store and task sets, nothing else.

write.py       report.html, one file that needs no network
live.py        the same pages over a run that may still be written
live_run.py    the run, its figures and charts as HTML
taskset.py     the pages of a task set
serving.py     how both are served
training.py    the report of a training and its curves
content.py     trajectories as the pages need them
charts.py      inline SVG
thumbnails.py  small pictures for the file
template.py    the page around it all: templates/ and static/
"""
