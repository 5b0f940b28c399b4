"""Renders requests for a vision-language model: token ids with images expanded, and pixels.

Inference in this process and training use the same code, so that a model is trained on its actual inputs.
Servers do the same: the chat template writes the text with one placeholder per picture, the text is tokenized
without further special tokens, and each placeholder is expanded to the number of image tokens of its picture.
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
from webgym.core.text import visible
from webgym.core.trajectory import ImageRef, Message, TextPart

THINK_START = "<think>"
THINK_END = "</think>"

_SMALL = 256 * 256
"""Largest picture that is cached, pixels: half of a small website's screenshots repeat earlier ones."""
_CACHED_PICTURES = 256
"""Number of cached pictures; at most 0.4 GB in patches."""


@dataclass(frozen=True, slots=True)
class Pixels:
    """Pictures in the input format of a Qwen-VL vision tower.

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
        prompt_ids: token ids, with image tokens expanded, up to the start of the reply.
        pixels: the pictures in order; ``None`` if there are none.
    """

    prompt_ids: list[int]
    pixels: Pixels | None


class Renderer:
    """Renders requests for one model.

    Args:
        tokenizer: a transformers tokenizer with a chat template.
        image_processor: a Qwen2-VL image processor, which gives ``pixel_values`` and ``image_grid_thw``.
        end_ids: token ids that end a reply; by default the tokenizer's end-of-sequence token.
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
        self._cached_pixels_of = lru_cache(_CACHED_PICTURES)(self._pixels_of)

    def prompt(self, messages: Sequence[Message], images: Mapping[str, bytes]) -> Encoded:
        """Render a request.

        Args:
            messages: the messages of the request.
            images: its pictures by name, encoded, at the size at which they are sent.

        Raises:
            PolicyError: a picture cannot be read or has another size than the request says, or a system
                message or a reply contains the image placeholder, so that placeholders and pictures do not
                match.
        """
        ids = self.prompt_ids(messages)
        return Encoded(ids, self.pixels(messages, images))

    def prompt_ids(self, messages: Sequence[Message]) -> list[int]:
        """The token ids of a request. Needs only the sizes of its pictures, which determine their token
        counts.

        Args:
            messages: the request.

        Raises:
            PolicyError: placeholders and pictures do not match.
        """
        return self.expanded(self.short_prompt_ids(messages), self.image_tokens(messages))

    def short_prompt_ids(self, messages: Sequence[Message]) -> list[int]:
        """The token ids of a request with one image token for each picture.

        Args:
            messages: the request.
        """
        ids: list[int] = self.tokenizer(self.text(messages), add_special_tokens=False)["input_ids"]
        return ids

    def expanded(self, ids: Sequence[int], counts: Sequence[int]) -> list[int]:
        """Expand the image token of each picture to the number of tokens of the picture.

        Args:
            ids: token ids with one image token for each picture.
            counts: number of tokens of each picture, in order.

        Raises:
            PolicyError: placeholders and pictures do not match.
        """
        expanded: list[int] = []
        placeholders = 0
        for token in ids:
            if token != self.image_id:
                expanded.append(token)
                continue
            placeholders += 1
            expanded += [token] * (counts[placeholders - 1] if placeholders <= len(counts) else 1)
        if placeholders != len(counts):
            raise PolicyError(f"the request has {len(counts)} pictures and {placeholders} image placeholders")
        return expanded

    def text(self, messages: Sequence[Message]) -> str:
        """The request as text, with a placeholder per picture, up to the start of the reply.

        Args:
            messages: the request.
        """
        rendered: str = self.tokenizer.apply_chat_template(
            [{"role": message.role, "content": _content(message)} for message in messages],
            tokenize=False,
            add_generation_prompt=True,
        )
        return rendered

    def pixels(self, messages: Sequence[Message], images: Mapping[str, bytes]) -> Pixels | None:
        """The pictures of a request, in its order; ``None`` if it has none.

        Args:
            messages: the request.
            images: its pictures, encoded, by name.

        Raises:
            PolicyError: a picture cannot be read, or has another size than the request says.
        """
        refs = pictures_of(messages)
        if not refs:
            return None
        pictures = [
            (self._cached_pixels_of if ref.width * ref.height <= _SMALL else self._pixels_of)(
                images[ref.screenshot], ref.width, ref.height
            )
            for ref in refs
        ]
        return Pixels(torch.cat([it.values for it in pictures]), torch.cat([it.grid for it in pictures]))

    def _pixels_of(self, data: bytes, width: int, height: int) -> Pixels:
        decoded = _decoded(data)
        if decoded.size != (width, height):
            raise PolicyError(
                f"a picture of {decoded.size} does not have the size {width} x {height} of the request"
            )
        processed = self.image_processor(images=[decoded], return_tensors="pt")
        return Pixels(processed["pixel_values"], processed["image_grid_thw"])

    def image_tokens(self, messages: Sequence[Message]) -> list[int]:
        """The number of tokens of each picture of a request, in order.

        Args:
            messages: the request.
        """
        merged: int = self.image_processor.merge_size**2
        patches = self.image_processor.get_number_of_image_patches
        # Without the last argument, transformers before 5.11 fails.
        return [patches(ref.height, ref.width, {}) // merged for ref in pictures_of(messages)]

    def image_mask(self, ids: Sequence[int]) -> list[int]:
        """1 for an image token and 0 for any other, as for models' ``mm_token_type_ids``.

        Args:
            ids: token ids of a prompt, a reply or both.
        """
        return [int(token == self.image_id) for token in ids]

    def opens_thinking(self, prompt_ids: Sequence[int]) -> bool:
        """Whether the chat template has opened the thinking, so that the reply begins inside of it.

        Args:
            prompt_ids: token ids of the whole prompt.
        """
        tail: str = self.tokenizer.decode(list(prompt_ids[-8:]))
        return tail.rstrip().endswith(THINK_START)

    def decode(self, reply_ids: Sequence[int]) -> str:
        """A reply as text, as servers decode it: without special tokens, with white space unchanged.

        Args:
            reply_ids: the sampled token ids, with or without the end token.
        """
        text: str = self.tokenizer.decode(
            list(reply_ids), skip_special_tokens=True, clean_up_tokenization_spaces=False
        )
        return text


def pictures_of(messages: Sequence[Message]) -> list[ImageRef]:
    """The pictures of a request, in order; a picture that occurs twice is listed twice."""
    return [part for message in messages for part in message.content if isinstance(part, ImageRef)]


def _content(message: Message) -> str | list[dict[str, str]]:
    """A message's content as :func:`webgym.agent.openai_policy.to_openai` sends it, in the form for chat
    templates; a user's text cannot open a turn or a picture, whoever made the request."""
    safe = visible if message.role == "user" else str
    if all(isinstance(part, TextPart) for part in message.content):
        return safe("".join(part.text for part in message.content if isinstance(part, TextPart)))
    return [
        {"type": "text", "text": safe(part.text)} if isinstance(part, TextPart) else {"type": "image"}
        for part in message.content
    ]


def _decoded(data: bytes) -> Image.Image:
    try:
        with Image.open(io.BytesIO(data)) as picture:
            return picture.convert("RGB")
    except (UnidentifiedImageError, OSError) as error:
        raise PolicyError("a screenshot cannot be read as an image") from error
