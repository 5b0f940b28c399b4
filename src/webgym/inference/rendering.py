"""From a request to what a vision-language model reads: token ids with images expanded, and pixels.

Inference in this process and training render with this very code, so that a model is trained on what it saw.
Servers do the same: the chat template writes the text with one placeholder per picture, the text is split
into tokens without further special tokens, and each placeholder becomes as many image tokens as its picture
has.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import torch
from PIL import Image, UnidentifiedImageError

from webgym.core.errors import PolicyError
from webgym.core.trajectory import ImageRef, Message, TextPart

THINK_START = "<think>"
THINK_END = "</think>"

_SMALL = 256 * 256
"""Pixels of a picture that is worth remembering: half of a small website's looks are at pages seen before."""
_REMEMBERED = 256
"""Small pictures; at most 0.4 GB in patches."""


@dataclass(frozen=True, slots=True)
class Pixels:
    """Pictures as a Qwen-VL vision tower reads them.

    Attributes:
        values: (patches of all pictures, channels x frames x patch side squared), float32.
        grid: (pictures, 3), int64: frames, rows and columns of patches.
    """

    values: torch.Tensor
    grid: torch.Tensor


@dataclass(frozen=True, slots=True)
class Encoded:
    """A request, ready for a model.

    Attributes:
        prompt_ids: token ids, image tokens expanded, the opening of the reply included.
        pixels: the pictures in order; ``None`` if there is none.
    """

    prompt_ids: list[int]
    pixels: Pixels | None


class Renderer:
    """Renders requests for one model.

    Args:
        tokenizer: of transformers, with a chat template.
        image_processor: of the Qwen2-VL kind: gives ``pixel_values`` and ``image_grid_thw``.
        end_ids: ids that end a reply; by default the tokenizer's end-of-sequence token.
    """

    def __init__(self, tokenizer: Any, image_processor: Any, end_ids: Iterable[int] = ()) -> None:
        self.tokenizer = tokenizer
        self.image_processor = image_processor
        self.end_ids = frozenset(end_ids) or frozenset({tokenizer.eos_token_id})
        self._image_token = getattr(tokenizer, "image_token", None) or "<|image_pad|>"
        self.image_id: int = tokenizer.convert_tokens_to_ids(self._image_token)
        self.pad_id: int = (
            tokenizer.eos_token_id if tokenizer.pad_token_id is None else tokenizer.pad_token_id
        )
        self._remembered = lru_cache(_REMEMBERED)(self._pixels_of)

    def prompt(self, messages: Sequence[Message], images: Mapping[str, bytes]) -> Encoded:
        """A request as the model reads it.

        Args:
            messages: of the request.
            images: its pictures by name, encoded, at the size at which they are sent.

        Raises:
            PolicyError: a picture cannot be read or has another size than the request says, or a text holds
                the image placeholder itself, so that placeholders and pictures do not match.
        """
        ids = self.prompt_ids(messages)
        return Encoded(ids, self.pixels(messages, images))

    def prompt_ids(self, messages: Sequence[Message]) -> list[int]:
        """The ids of a request, without looking at its pictures: their sizes say how many tokens they take.

        Raises:
            PolicyError: placeholders and pictures do not match.
        """
        return self.expanded(self.short_prompt_ids(messages), self.image_tokens(messages))

    def short_prompt_ids(self, messages: Sequence[Message]) -> list[int]:
        """The ids of a request with one image token for each picture."""
        ids: list[int] = self.tokenizer(self.text(messages), add_special_tokens=False)["input_ids"]
        return ids

    def expanded(self, ids: Sequence[int], counts: Sequence[int]) -> list[int]:
        """Ids with one image token for each picture, which becomes as many as the picture takes.

        Args:
            ids: as a tokenizer gives them.
            counts: of each picture, in order.

        Raises:
            PolicyError: placeholders and pictures do not match.
        """
        found: list[int] = []
        met = 0
        for token in ids:
            if token != self.image_id:
                found.append(token)
                continue
            met += 1
            found += [token] * (counts[met - 1] if met <= len(counts) else 1)
        if met != len(counts):
            raise PolicyError(f"the request has {len(counts)} pictures and {met} image placeholders")
        return found

    def text(self, messages: Sequence[Message]) -> str:
        """The request as text, a placeholder per picture, the opening of the reply included."""
        rendered: str = self.tokenizer.apply_chat_template(
            [{"role": each.role, "content": _content(each)} for each in messages],
            tokenize=False,
            add_generation_prompt=True,
        )
        return rendered

    def pixels(self, messages: Sequence[Message], images: Mapping[str, bytes]) -> Pixels | None:
        """The pictures of a request, in its order; ``None`` if it has none.

        Raises:
            PolicyError: a picture cannot be read, or has another size than the request says.
        """
        refs = pictures_of(messages)
        if not refs:
            return None
        found = [
            (self._remembered if ref.width * ref.height <= _SMALL else self._pixels_of)(
                images[ref.screenshot], ref.width, ref.height
            )
            for ref in refs
        ]
        return Pixels(torch.cat([each.values for each in found]), torch.cat([each.grid for each in found]))

    def _pixels_of(self, data: bytes, width: int, height: int) -> Pixels:
        decoded = _decoded(data)
        if decoded.size != (width, height):
            raise PolicyError(f"a picture of {decoded.size} was to be sent as {width} x {height}")
        made = self.image_processor(images=[decoded], return_tensors="pt")
        return Pixels(made["pixel_values"], made["image_grid_thw"])

    def image_tokens(self, messages: Sequence[Message]) -> list[int]:
        """How many tokens each picture of a request takes, in order."""
        merged: int = self.image_processor.merge_size**2
        patches = self.image_processor.get_number_of_image_patches
        return [patches(ref.height, ref.width) // merged for ref in pictures_of(messages)]

    def image_mask(self, ids: Sequence[int]) -> list[int]:
        """1 for an image token and 0 for any other: what models call ``mm_token_type_ids``."""
        return [int(token == self.image_id) for token in ids]

    def opens_thinking(self, prompt_ids: Sequence[int]) -> bool:
        """Whether the chat template has opened the thinking already, so that the reply goes on inside."""
        tail: str = self.tokenizer.decode(list(prompt_ids[-8:]))
        return tail.rstrip().endswith(THINK_START)

    def decode(self, reply_ids: Sequence[int]) -> str:
        """A reply as a server gives it: without special tokens, white space as it is."""
        text: str = self.tokenizer.decode(
            list(reply_ids), skip_special_tokens=True, clean_up_tokenization_spaces=False
        )
        return text


def pictures_of(messages: Sequence[Message]) -> list[ImageRef]:
    """The pictures of a request, in its order; one that is shown twice comes twice."""
    return [part for each in messages for part in each.content if isinstance(part, ImageRef)]


def _content(message: Message) -> str | list[dict[str, str]]:
    """As :func:`webgym.agent.request.to_openai` sends it, in the words of chat templates."""
    if all(isinstance(part, TextPart) for part in message.content):
        return "".join(part.text for part in message.content if isinstance(part, TextPart))
    return [
        {"type": "text", "text": part.text} if isinstance(part, TextPart) else {"type": "image"}
        for part in message.content
    ]


def _decoded(data: bytes) -> Image.Image:
    try:
        with Image.open(io.BytesIO(data)) as picture:
            return picture.convert("RGB")
    except (UnidentifiedImageError, OSError) as error:
        raise PolicyError("a screenshot cannot be read as an image") from error
