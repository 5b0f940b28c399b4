"""Prints what LLaMA-Factory's own loader makes of an export. Runs with its Python, not with ours.

python llamafactory_loads.py FOLDER
"""

import json
import sys

from llamafactory.data.loader import _get_merged_dataset
from llamafactory.hparams import DataArguments, ModelArguments
from transformers import TrainingArguments

folder = sys.argv[1]
data = DataArguments(
    dataset="webgym", dataset_dir=folder, media_dir=folder, mask_history=True, template="qwen2_vl"
)
rows = _get_merged_dataset(
    ["webgym"],
    ModelArguments(model_name_or_path="none"),
    data,
    TrainingArguments(output_dir=f"{folder}/out", use_cpu=True),
    stage="sft",
)
names = ("_system", "_prompt", "_response", "_images")
print(json.dumps([{name: row[name] for name in names} for row in rows]))
