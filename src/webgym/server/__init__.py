"""Many browser slots behind one address.

operations.py  the one table of operations: routing, the OpenAPI document and the client follow it
messages.py    what travels between client and server
client.py      BrowserClient and Session: what the collector uses; straight to a worker, or by the gateway
config.py      ServerConfig, GatewayConfig, ClientLimits: every limit, with its unit and its reason
http.py        HTTP: authentication, limits, decoding, errors, streams of state
listening.py   sockets, and requests of bounded size
callers.py     tokens, how many sessions one client may hold, the audit log
metrics.py     what Prometheus sees

A worker:

worker.py      what each operation does, and the HTTP application whose routes are the operations
leases.py      who may use which slot, and until when
pool.py        slots: brought up, lent, cleaned, replaced
admission.py   run permits, and a queue of its own for each type of operation

A gateway, one address for many workers:

gateway.py     what each operation does, over all workers
fleet.py       keeps workers up, wherever they run; who gets the next free slot
subprocess_worker.py  workers as processes of this machine, which end with their parent
ray_hosts.py   workers on the nodes of a Ray cluster

compat/        the HTTP API of the WebGym authors' server, in front of either
"""
