"""A server that behaves as vLLM's documentation says, or as one of its reported bugs does; no model in it.

It reads the known screenshot as the ``selftest.json`` of the weights that it was given says, so weights are
told apart as a model would. In a thread for most tests; as a program, for those of a server of ours::

    python fake_vllm.py serve MODEL --served-model-name NAME --port PORT ...
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

LORA = {"/v1/load_lora_adapter", "/v1/unload_lora_adapter"}
VERSION = {"/weight_info", "/update_weight_version", "/weight_checker"}
DEV = {"/pause", "/resume", "/is_paused", "/collective_rpc", "/reset_prefix_cache", "/reset_mm_cache"}
DEV |= VERSION
GET = {"/v1/models", "/weight_info", "/is_paused"}

PROMPT = [1, *[7] * 80, 2, 3]
"""The known request, as it reads it: 80 tokens of the picture, whose id is 7."""
REPLY = [11, 12, 13, 14, 15, 16, 17, 18]
FIRST = [-0.5, -0.1, -0.25, -0.5, -0.125, -0.5, -0.5, -0.25]
"""The log-probabilities of the reply to it with the weights that learning starts from."""


class FakeVllm:
    """What the server knows. ``quirks`` are names that the methods below look for."""

    def __init__(self, name: str = "base", weights: str = "", *quirks: str) -> None:
        self.name = name
        self.weights = weights
        self.quirks = set(quirks)
        self.label = "default"
        self.adapters: dict[str, str] = {}
        self.first_of: dict[str, str] = {}
        self.is_paused = False
        self.log: list[str] = []
        self.asked: list[dict[str, Any]] = []
        self.in_flight = 0
        self.go_on = threading.Event()
        self.go_on.set()
        self.calls_itself = ""
        self.frozen = ""
        self.faults: dict[str, list[str]] = {}
        """What goes wrong with the next requests, as in ``{"POST /pause": ["500", "breaks_off"]}``."""
        self.is_away = False
        self.previous = ""
        self.stale = set[str]()
        """Weights that were loaded in part."""
        self.weight_info_asked = 0
        self.url = ""

    def offers(self, path: str) -> bool:
        if path in LORA:
            return "lora" in self.quirks
        if path in VERSION and "no_version" in self.quirks:
            return False
        return "dev" in self.quirks if path in DEV else path in {"/v1/models", "/v1/chat/completions"}

    def answer(self, method: str, path: str, body: dict[str, Any]) -> tuple[int, Any]:
        if not self.offers(path):
            return 404, {"detail": "Not Found"}
        if (method == "GET") != (path in GET):
            return 405, {"detail": "Method Not Allowed"}
        if path != "/v1/chat/completions" and method == "POST":
            self.log.append(f"{path.removeprefix('/v1')[1:]} {self.in_flight}".removesuffix(" 0"))
        handler = getattr(self, "do_" + path.removeprefix("/v1").strip("/").replace("/", "_"), None)
        return (200, {}) if handler is None else handler(body)

    # --- endpoints ------------------------------------------------------------------------------------------

    def do_models(self, _: dict[str, Any]) -> tuple[int, Any]:
        cards = [{"id": name, "root": path, "parent": self.name} for name, path in self.adapters.items()]
        return 200, {"object": "list", "data": [{"id": self.name, "root": self.weights}, *cards]}

    def do_weight_info(self, _: dict[str, Any]) -> tuple[int, Any]:
        self.weight_info_asked += 1
        return 200, {"weight_version": self.label}

    def do_load_lora_adapter(self, body: dict[str, Any]) -> tuple[int, Any]:
        name, path = body["lora_name"], body["lora_path"]
        if "refuses" in self.quirks or name in self.adapters or not Path(path).is_absolute():
            return 400, {"error": {"message": f"cannot load {name}\nTraceback ..."}}
        self.adapters[name] = path
        (self.stale.add if "stale_part" in self.quirks else self.stale.discard)(path)
        self.first_of.setdefault(name, path)
        return 200, f"Success: LoRA adapter '{name}' added successfully."

    def do_unload_lora_adapter(self, body: dict[str, Any]) -> tuple[int, Any]:
        if self.adapters.pop(body["lora_name"], None) is None:
            return 404, {"error": {"message": "no such adapter"}}
        return 200, "Success"

    def do_pause(self, _: dict[str, Any]) -> tuple[int, Any]:
        self.is_paused = True
        return 200, {"status": "paused"}

    def do_resume(self, _: dict[str, Any]) -> tuple[int, Any]:
        self.is_paused = False
        return 200, {"status": "resumed"}

    def do_is_paused(self, _: dict[str, Any]) -> tuple[int, Any]:
        return 200, {"is_paused": self.is_paused}

    def do_weight_checker(self, body: dict[str, Any]) -> tuple[int, Any]:
        assert body["action"] == "checksum"
        workers = {"dp0:tp0": self.weights, "dp1:tp0": self.weights}
        if "stale_workers" in self.quirks:
            workers = dict.fromkeys(workers, self.previous)
        if "stale_copy" in self.quirks:
            workers["dp1:tp0"] = "half of each"
        return 200, {"checksums": {f"{key}:norm.weight": f"sum of {of}" for key, of in workers.items()}}

    def do_collective_rpc(self, body: dict[str, Any]) -> tuple[int, Any]:
        assert body["method"] == "reload_weights"
        assert self.is_paused
        if "refuses" in self.quirks:
            self.quirks.remove("refuses")
            self.weights = "half of each"
            return 500, {"error": {"message": "a tensor is missing"}}
        self.previous, self.weights = self.weights, body["kwargs"]["weights_path"]
        (self.stale.add if "stale_part" in self.quirks else self.stale.discard)(self.weights)
        return 200, {"results": [None]}

    def do_update_weight_version(self, body: dict[str, Any]) -> tuple[int, Any]:
        self.label = body["new_version"]
        return 200, {}

    def do_chat_completions(self, body: dict[str, Any]) -> tuple[int, Any]:
        assert not self.is_paused
        model = body["model"]
        if model not in (self.name, *self.adapters):
            return 404, {"error": {"message": f"The model `{model}` does not exist."}}
        self.asked.append(body)
        weights = self.adapters.get(model, self.weights)
        weights = self.frozen or weights
        if "caches_names" in self.quirks:
            weights = self.first_of.get(model, weights)
        self.in_flight += 1
        if body["temperature"] > 0:
            self.go_on.wait(10)
        self.in_flight -= 1
        return 200, self.completion(body, weights)

    def completion(self, body: dict[str, Any], weights: str) -> dict[str, Any]:
        test = Path(weights, "selftest.json")
        text, prompt, ids, logprobs, read = "click", [1, 2, 3], [5, 6], [-0.5, -0.1], 3
        if body["temperature"] == 0:
            prompt, ids, logprobs = [*PROMPT], REPLY, FIRST
            text, image = "the heading", PROMPT[1]
            if test.exists():
                held = json.loads(test.read_bytes())
                before, after = held["before"]["logprobs"], held["after"]["logprobs"]
                logprobs = before if "ignores_weights" in self.quirks else after
                if "stale_part" in self.quirks and weights in self.stale:
                    logprobs = [(old + new) / 2 for old, new in zip(before, after, strict=True)]
            if "rounds" in self.quirks:
                logprobs = [each - 0.04 for each in logprobs]
            if "half_loads" in self.quirks:
                logprobs = [each - place % 2 for place, each in enumerate(logprobs)]
            if "garbles" in self.quirks:
                ids, text = [each + 1 for each in ids], "?"
            if "resizes" in self.quirks:
                prompt.insert(prompt.index(image), image)
            if "another_template" in self.quirks:
                prompt = [9, *prompt]
            read = len(prompt)
            if "before_expansion" in self.quirks:
                first = prompt.index(image)
                prompt = [each for place, each in enumerate(prompt) if each != image or place == first]
        choice = {
            "index": 0,
            "message": {"role": "assistant", "content": text},
            "finish_reason": "stop",
            "logprobs": {"content": [{"token": "t", "logprob": each} for each in logprobs]},
        }
        if body["return_weight_versions"] and self.offers("/weight_info"):
            choice["weight_versions"] = [{"version": self.label}]
        found: dict[str, Any] = {
            "model": self.calls_itself or body["model"],
            "choices": [choice],
            "usage": {"prompt_tokens": read},
        }
        if "no_tokens" not in self.quirks:
            assert body["return_token_ids"]
            assert body["logprobs"]
            choice["token_ids"] = ids
            found["prompt_token_ids"] = prompt
        return found


def make_server(fake: FakeVllm, port: int = 0) -> ThreadingHTTPServer:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            self.handle_any("GET")

        def do_POST(self) -> None:
            self.handle_any("POST")

        def handle_any(self, method: str) -> None:
            length = int(self.headers.get("content-length") or 0)
            body = json.loads(self.rfile.read(length) or b"{}")
            path = urlsplit(self.path).path
            if path == "/crash":
                os._exit(9)
            fault = (fake.faults.get(f"{method} {path}") or [""]).pop(0)
            if fault == "breaks_off" or fake.is_away:
                self.close_connection = True
                return
            if fault == "500":
                fake.answer(method, path, body)  # it has been done nevertheless
            status, found = (500, {}) if fault else fake.answer(method, path, body)
            data = json.dumps(found).encode()
            self.send_response(status)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, *_: Any) -> None:
            return

    class Server(ThreadingHTTPServer):
        def handle_error(self, *_: Any) -> None:
            return  # of a client that does not wait any more

    server = Server(("127.0.0.1", port), Handler)
    server.daemon_threads = True
    fake.url = f"http://127.0.0.1:{server.server_port}/v1"
    return server


@contextmanager
def running(*quirks: str, of: type[FakeVllm] = FakeVllm, weights: str = "") -> Iterator[FakeVllm]:
    """A server in a thread."""
    fake = of("base", weights, *quirks)
    server = make_server(fake)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield fake
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def main() -> None:
    """``vllm serve``; FAKE_VLLM in the environment holds quirks, FAKE_VLLM_PIDS a file for process ids."""
    given = sys.argv[1:]
    assert given[0] == "serve"
    options = dict(pairwise(given))
    quirks = os.environ.get("FAKE_VLLM", "").split()
    print("GPUS", os.environ.get("CUDA_VISIBLE_DEVICES"))
    print("INFO starting", *given, flush=True)
    assert (
        not {"RANK", "WORLD_SIZE", "MASTER_ADDR", "ACCELERATE_USE_FSDP", "TORCHELASTIC_RUN_ID"}
        & os.environ.keys()
    )
    if "dies" in quirks:
        print("RuntimeError: Failed to infer device type\nbye", file=sys.stderr)
        sys.exit(1)
    if "engine" in quirks:  # as vLLM's engine processes: it does not notice that the server is gone
        engine = subprocess.Popen(["sleep", "600"], start_new_session=True)
        with Path(os.environ["FAKE_VLLM_PIDS"]).open("a") as file:
            file.write(f"{os.getpid()} {engine.pid}\n")
    if "hangs" in quirks:
        time.sleep(600)
    if os.environ.get("VLLM_ALLOW_RUNTIME_LORA_UPDATING") == "True" and "--enable-lora" in given:
        quirks.append("lora")
    if os.environ.get("VLLM_SERVER_DEV_MODE") == "1" and "no_dev" not in quirks:
        quirks.append("dev")
    fake = FakeVllm(options["--served-model-name"], given[1], *quirks)
    make_server(fake, int(options["--port"])).serve_forever()


if __name__ == "__main__":
    main()
