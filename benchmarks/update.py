"""Speed and memory of a training update, compared with the estimate.

    python benchmarks/update.py                                a tiny model on the CPU, to check that it runs
    python benchmarks/update.py --model 8b                     Qwen3-VL-8B's shapes, LoRA, on one GPU
    python benchmarks/update.py --model 8b --full --layers 12  all weights of some layers

Weights and samples are random, as the cost depends on shapes only; nothing is downloaded.
"""

from __future__ import annotations

import argparse
import io
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from PIL import Image
from transformers import AutoModelForImageTextToText, Qwen3VLConfig
from transformers.models.qwen2_vl.image_processing_pil_qwen2_vl import Qwen2VLImageProcessorPil

from webgym.core.trajectory import ImageRef, Message
from webgym.inference.model import Loaded
from webgym.inference.rendering import Renderer
from webgym.train.config import LearnConfig
from webgym.train.estimate import GIB, KNOWN_GPUS, QWEN3_VL_8B, Gpus, Workload, estimate, shapes_from
from webgym.train.objectives import FilteredBC
from webgym.train.samples import Sample
from webgym.train.update import Updater

TINY: dict[str, Any] = {
    "text_config": {
        "vocab_size": 1024,
        "hidden_size": 128,
        "intermediate_size": 384,
        "num_hidden_layers": 4,
        "num_attention_heads": 4,
        "num_key_value_heads": 4,
        "head_dim": 32,
        "rope_scaling": {"rope_type": "default", "mrope_section": [4, 6, 6], "mrope_interleaved": True},
    },
    "vision_config": {
        "depth": 4,
        "hidden_size": 128,
        "intermediate_size": 384,
        "num_heads": 4,
        "patch_size": 16,
        "out_hidden_size": 128,
        "num_position_embeddings": 256,
        "deepstack_visual_indexes": [1, 2],
    },
    "tie_word_embeddings": True,
}
IMAGE = 5


def shapes(name: str, layers: int | None) -> Any:
    shape = TINY if name == "tiny" else QWEN3_VL_8B
    text = shape["text_config"] | ({"num_hidden_layers": layers} if layers else {})
    special = {
        "image_token_id": IMAGE,
        "video_token_id": 6,
        "vision_start_token_id": 7,
        "vision_end_token_id": 8,
    }
    return Qwen3VLConfig(**(shape | {"text_config": text} | special))


def random_samples(count: int, work: Workload, size: tuple[int, int]) -> list[Sample]:
    random = np.random.default_rng(0)
    pictures = {}
    for number in range(work.pictures):
        out = io.BytesIO()
        Image.fromarray(random.integers(0, 256, (size[1], size[0], 3), np.uint8)).save(out, "PNG")
        pictures[str(number)] = out.getvalue()
    message = Message("user", tuple(ImageRef(name, *size) for name in pictures))
    image = [7, *[IMAGE] * (work.picture_patches // 4), 8]
    made = []
    for _ in range(count):
        text = random.integers(10, 1000, work.text_tokens).tolist()
        prompt = torch.tensor([*(image * work.pictures), *text], dtype=torch.int32)
        reply = torch.tensor(random.integers(10, 1000, work.reply_tokens), dtype=torch.int32)
        made.append(Sample(prompt, reply, None, 1.0, "", (message,), pictures.__getitem__))
    return made


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--model", choices=["tiny", "8b"], default="tiny")
    parser.add_argument("--layers", type=int)
    parser.add_argument("--full", action="store_true", help="train all weights instead of adapters")
    parser.add_argument("--checkpointing", action="store_true")
    parser.add_argument("--micro-batch", type=int, default=4)
    parser.add_argument("--samples", type=int, default=16)
    parser.add_argument("--gpu", choices=KNOWN_GPUS, default="h200")
    given = parser.parse_args()

    tiny, device = given.model == "tiny", "cuda" if torch.cuda.is_available() else "cpu"
    size = (192, 128) if tiny else (1280, 768)
    patches = size[0] * size[1] // 256
    work = Workload(
        picture_patches=patches, text_tokens=100 if tiny else 2500, reply_tokens=30 if tiny else 300
    )
    config = LearnConfig.model_validate(
        {
            "model": given.model,
            "replay": {"steps": given.samples, "passes": 1},
            "update": {
                "batch": given.samples,
                "micro_batch": given.micro_batch,
                "weights": "float32" if tiny else "bfloat16",
                "gradient_checkpointing": given.checkpointing,
                "lora": None if given.full else {"rank": 32},
            },
        }
    )
    kind = shapes(given.model, given.layers)
    with torch.device(device):
        model = AutoModelForImageTextToText.from_config(kind, dtype=getattr(torch, config.update.weights))
    tokenizer = SimpleNamespace(eos_token_id=0, pad_token_id=1, convert_tokens_to_ids=lambda _: IMAGE)
    processor = Qwen2VLImageProcessorPil(patch_size=16, size={"shortest_edge": 1024, "longest_edge": 2**24})
    renderer = Renderer(tokenizer, processor)
    updater = Updater(config.update, FilteredBC(), Loaded(model, renderer))
    samples = random_samples(given.samples, work, size)
    updater.update(samples[: given.micro_batch])  # warm up kernels and allocator
    if device == "cuda":
        torch.cuda.reset_peak_memory_stats()
    report = updater.update(samples)
    expected = estimate(config, KNOWN_GPUS[given.gpu], work, shapes_from(kind))
    rate = (report.tokens + report.prompt_tokens) / report.seconds
    print(f"model      {expected.parameters / 1e9:.3f} B weights, {expected.trained / 1e6:.1f} M trained")
    print(f"speed      {rate:,.0f} tokens/s, {report.samples / report.seconds:.2f} samples/s")
    if device == "cuda":
        gpu: Gpus = KNOWN_GPUS[given.gpu]
        used = expected.flops / report.seconds / (gpu.peak_tflops * 1e12)
        peak = torch.cuda.max_memory_allocated() / GIB
        print(f"memory     {peak:.1f} GiB peak; estimated {sum(expected.memory.values()) / GIB:.1f}")
        print(f"utilised   {used:.1%} of {gpu.peak_tflops:.0f} TFLOP/s")


if __name__ == "__main__":
    main()
