"""Many browser slots behind one address.

operations.py  the one table of operations: routing, the OpenAPI document and the client follow it
messages.py    what travels between client and server
client.py      BrowserClient and Session: what the collector uses
routing.py     straight to the worker that holds a session, or through the gateway
config.py      ServerConfig, GatewayConfig, ClientLimits: every limit, with its unit and its reason
http.py        HTTP: authentication, limits, decoding, errors
listening.py   sockets, and requests of bounded size

A worker:

app.py         HTTP in front of a service
service.py     what each operation does
leases.py      who may use which slot, and until when
pool.py        slots: brought up, lent, cleaned, replaced
admission.py   run permits, and a queue of its own for each type of operation
metrics.py     what Prometheus sees
quota.py       how many sessions one client may hold
feed.py        tells those who watch what changed
run_worker.py  running a worker, in this process
subprocess_worker.py  running one as a process that ends with its parent

A gateway, one address for many workers:

gateway.py     what each operation does, over all workers
queue.py       who gets the next free slot
relay.py       passes calls on as bytes
fleet.py       keeps workers up, wherever they run
local.py       workers as processes of this machine
ray_hosts.py   workers on the nodes of a Ray cluster

compat/        the HTTP API of the WebGym authors' server, in front of either
"""
