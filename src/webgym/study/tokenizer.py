"""The tokenizer of the tiny policy, which maps every word to a token.

Its vocabulary is closed: the words of the small websites, the keywords of the compact format
(:mod:`webgym.agent.compact`), numbers, and the coordinates of the screen's cells. Any other word is an
unknown token. How an instruction asks for the answer, in brackets at its end, is left out: on the small
websites it is always the same. Special tokens and chat template follow Qwen's.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

from webgym.core.action import GRID

CELL: Final = 32
"""Side of a screen cell, pixels: two by two patches of 16, which is one image token."""

MOST_NUMBER: Final = 99
"""Largest number in the vocabulary."""

SPECIAL: Final = (
    "<|endoftext|>",  # padding
    "<|im_start|>",
    "<|im_end|>",
    "<|vision_start|>",
    "<|vision_end|>",
    "<|image_pad|>",
    "<unk>",
)
ROLES: Final = ("system", "user", "assistant")
GRAMMAR: Final = (
    *"act with memory task progress intention last nothing unreadable changed unchanged step of note".split(),
    *"left_click type scroll up down wait go_back navigate answer , ; = + -".split(),
)

_TEMPLATE = """\
{%- for message in messages -%}
<|im_start|>{{ message.role + '\\n' }}
{%- if message.content is string -%}{{ message.content }}{%- else -%}
{%- for part in message.content -%}
{%- if part.type == 'text' -%}{{ part.text }}{%- endif -%}
{%- if part.type == 'image' -%}<|vision_start|><|image_pad|><|vision_end|>{%- endif -%}
{%- endfor -%}
{%- endif -%}
<|im_end|>{{ '\\n' }}
{%- endfor -%}
{%- if add_generation_prompt -%}<|im_start|>{{ 'assistant\\n' }}{%- endif -%}"""


def cell_centres(length: int) -> list[int]:
    """The centres of the cells along a side of ``length`` pixels, on the grid of coordinates."""
    count = length // CELL
    return [round((index + 0.5) / count * GRID) for index in range(count)]


def vocabulary(words: Iterable[str], viewport: tuple[int, int]) -> list[str]:
    """All tokens in order, the special ones first.

    Args:
        words: of the websites and their tasks.
        viewport: width and height, multiples of :data:`CELL`.
    """
    points = {str(value) for side in viewport for value in cell_centres(side)}
    numbers = [str(number) for number in range(MOST_NUMBER + 1)]
    words_of_format = [*ROLES, *GRAMMAR, *numbers, *sorted(points - set(numbers), key=int)]
    return list(dict.fromkeys([*SPECIAL, *words_of_format, *sorted(set(words))]))


def make_tokenizer(words: Iterable[str], viewport: tuple[int, int]) -> Any:
    """Make a transformers tokenizer with a chat template.

    Args:
        words: of the websites and their tasks.
        viewport: width and height, multiples of :data:`CELL`.
    """
    from tokenizers import AddedToken, Regex, Tokenizer, models, normalizers, pre_tokenizers
    from transformers import PreTrainedTokenizerFast

    ids = {token: number for number, token in enumerate(vocabulary(words, viewport))}
    tokenizer = Tokenizer(models.WordLevel(ids, unk_token="<unk>"))  # noqa: S106
    tokenizer.normalizer = normalizers.Replace(Regex(r" \(answer [^)]*\)"), "")
    tokenizer.pre_tokenizer = pre_tokenizers.Sequence(
        [pre_tokenizers.WhitespaceSplit(), pre_tokenizers.Split(Regex("[,;=]"), "isolated")]
    )
    tokenizer.add_special_tokens([AddedToken(token, special=True, normalized=False) for token in SPECIAL])
    return PreTrainedTokenizerFast(
        tokenizer_object=tokenizer,
        unk_token="<unk>",  # noqa: S106
        pad_token="<|endoftext|>",  # noqa: S106
        eos_token="<|im_end|>",  # noqa: S106
        chat_template=_TEMPLATE,
        clean_up_tokenization_spaces=False,
    )
