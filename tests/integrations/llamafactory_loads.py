"""Prints what LLaMA-Factory's own loader and processor make of an export with the settings beside it. Runs
with its Python, not with ours.

python llamafactory_loads.py FOLDER
"""

import json
import sys
from pathlib import Path

import yaml
from llamafactory.data.loader import _get_merged_dataset
from llamafactory.data.template import TEMPLATES
from llamafactory.hparams import DataArguments, ModelArguments
from PIL import Image
from transformers import TrainingArguments

folder = sys.argv[1]
settings = yaml.safe_load((Path(folder) / "train.yaml").read_text())
given = {name: settings[name] for name in ("dataset", "mask_history", "template", "cutoff_len")}
data = DataArguments(dataset_dir=folder, media_dir=folder, **given)
model = ModelArguments(model_name_or_path="none", image_max_pixels=settings["image_max_pixels"])
rows = _get_merged_dataset(
    ["webgym"], model, data, TrainingArguments(output_dir=f"{folder}/out", use_cpu=True), stage="sft"
)
names = ("_system", "_prompt", "_response", "_images")
limits = {"image_max_pixels": model.image_max_pixels, "image_min_pixels": model.image_min_pixels}
plugin = TEMPLATES[data.template].mm_plugin


def sizes(path: str) -> list[tuple[int, int]]:
    picture = Image.open(path)
    return [picture.size, plugin._preprocess_image(picture, **limits).size]


print(
    json.dumps(
        [{name: row[name] for name in names} | {"sizes": list(map(sizes, row["_images"]))} for row in rows]
    )
)
