"""The HTTP API of the WebGym authors' browser server, spoken in front of one of ours.

Their clients switch by changing an address. Everything here goes through :class:`BrowserClient`, so that
it works in front of a worker or a gateway alike.

app.py        the paths, the key, and what an error looks like there
instances.py  which instance holds which session, and until when
commands.py   from a command to actions, gestures and readings
regions.py    interactive elements in their shape
config.py     every limit, with its unit and its reason
"""
