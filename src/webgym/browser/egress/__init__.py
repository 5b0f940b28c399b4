"""The only way out: a SOCKS5 proxy that every connection of every browser goes through.

proxy.py       Egress: the proxy, one per worker process; its protocol and the splicing of bytes
dial.py        from a name to a connection, or why there is none; how often one host is connected to
policy.py      what may be connected to: the operator's rules, then the kinds of addresses
hosts.py       every spelling of a host, read as a URL parser reads it
addresses.py   what kind of address this is
resolver.py     names to addresses, so that a slow name holds up no other; what this machine's network says
budget.py      what one session may use of all that
config.py      every limit, with its unit and its reason
"""
