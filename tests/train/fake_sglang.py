"""A server that behaves as SGLang's own endpoints say (0.5.23), on the stand-in for vLLM; no model in it.

As a program: ``python fake_sglang.py serve --config FILE --model-path MODEL --served-model-name NAME ...``.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))
from tests.train.fake_vllm import FakeVllm, make_server

ADAPTERS = {"/load_lora_adapter", "/unload_lora_adapter"}
OWN = {"/v1/models", "/v1/chat/completions", "/model_info", "/update_weight_version", "/weights_checker"}
OWN |= {"/pause_generation", "/continue_generation", "/update_weights_from_disk"}


class FakeSglang(FakeVllm):
    """Its endpoints; adapters are part of a model's name, and ids and versions stand elsewhere in replies."""

    def offers(self, path: str) -> bool:
        return path in OWN or (path in ADAPTERS and "lora" in self.quirks)

    def answer(self, method: str, path: str, body: dict[str, Any]) -> tuple[int, Any]:
        if path == "/model_info":
            return 200, {"model_path": self.weights, "weight_version": self.label}
        return super().answer(method, path, body)

    def do_pause_generation(self, body: dict[str, Any]) -> tuple[int, Any]:
        assert body["mode"] in ("abort", "retract", "in_place")
        return self.do_pause(body)

    def do_continue_generation(self, body: dict[str, Any]) -> tuple[int, Any]:
        return self.do_resume(body)

    def do_update_weights_from_disk(self, body: dict[str, Any]) -> tuple[int, Any]:
        assert body["flush_cache"]
        if "refuses" in self.quirks:
            self.quirks.remove("refuses")
            self.weights = "half of each"
            return 400, {"success": False, "message": "a tensor is missing"}
        self.previous, self.weights, self.label = self.weights, body["model_path"], body["weight_version"]
        (self.stale.add if "stale_part" in self.quirks else self.stale.discard)(self.weights)
        return 200, {"success": True, "message": ""}

    def do_weights_checker(self, _: dict[str, Any]) -> tuple[int, Any]:
        held = self.previous if "stale_workers" in self.quirks else self.weights
        return 200, {"success": True, "ranks": [{"checksums": {"norm.weight": f"sum of {held}"}}]}

    def do_chat_completions(self, body: dict[str, Any]) -> tuple[int, Any]:
        named = body["model"]
        base, _, adapter = named.partition(":")
        assert base == self.name
        status, found = super().do_chat_completions(body | {"model": adapter or base})
        if status == 200:
            [choice] = found["choices"]
            choice["response_token_ids"] = choice.pop("token_ids")
            choice["prompt_token_ids"] = found.pop("prompt_token_ids")
            choice.pop("weight_versions", None)
            found |= {"model": named, "metadata": {"weight_version": self.label}}
        return status, found


def main() -> None:
    """``sglang serve``."""
    given = sys.argv[1:]
    assert given[0] == "serve"
    options = dict(pairwise(given))
    assert "api-key: " in Path(options["--config"]).read_text()
    quirks = ["lora"] if "--enable-lora" in given else []
    fake = FakeSglang(options["--served-model-name"], options["--model-path"], *quirks)
    make_server(fake, int(options["--port"])).serve_forever()


if __name__ == "__main__":
    main()
