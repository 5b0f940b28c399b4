"""What processes of tests import: ours, and what ours imports only when it is used."""

import peft  # noqa: F401
import tests.train.trains_until_killed
import tests.train.updating  # noqa: F401
import torch.distributed.checkpoint.state_dict
import torch.distributed.fsdp  # noqa: F401
import transformers.models.qwen2_vl.image_processing_pil_qwen2_vl  # noqa: F401

import webgym.inference.vision  # noqa: F401
