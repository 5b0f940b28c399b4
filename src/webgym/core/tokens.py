"""Token ids in records: exact, compact, and readable without this package.

A request to a vision-language model is thousands of ids, most of them one image token repeated. They are
stored as base64 text (by the JSON encoder) of a zlib stream of little-endian 32-bit values::

    ids = numpy.frombuffer(zlib.decompress(base64.b64decode(text)), "<i4")
    log_probabilities = numpy.frombuffer(zlib.decompress(base64.b64decode(text)), "<f4")
"""

from __future__ import annotations

import sys
import zlib
from array import array
from collections.abc import Sequence
from typing import Self

import msgspec


class ReplyTokens(msgspec.Struct, frozen=True, omit_defaults=True):
    """The tokens that an endpoint read and sampled for one reply, for training on exactly these.

    Create it with :meth:`of`; the attributes are packed as the module's docstring describes.

    Attributes:
        prompt: token ids of the request after the expansion of images, int32.
        reply: sampled token ids, including the end token if it was sampled, int32.
        logprobs: log-probability of each reply id under the distribution that it was sampled from (after
            temperature, top-p and top-k), float32; ``None`` if the endpoint gives none.
    """

    prompt: bytes
    reply: bytes
    logprobs: bytes | None = None

    @classmethod
    def of(
        cls, prompt_ids: Sequence[int], reply_ids: Sequence[int], logprobs: Sequence[float] | None = None
    ) -> Self:
        """Pack ids and log-probabilities.

        Raises:
            ValueError: the number of log-probabilities is not the number of reply ids.
        """
        if logprobs is not None and len(logprobs) != len(reply_ids):
            raise ValueError(f"{len(logprobs)} log-probabilities for {len(reply_ids)} reply tokens")
        packed = None if logprobs is None else _pack("f", logprobs)
        return cls(_pack("i", prompt_ids), _pack("i", reply_ids), packed)

    @property
    def prompt_ids(self) -> list[int]:
        """Ids of the request, images expanded."""
        return [int(value) for value in _unpack("i", self.prompt)]

    @property
    def reply_ids(self) -> list[int]:
        """Ids of the reply."""
        return [int(value) for value in _unpack("i", self.reply)]

    @property
    def reply_logprobs(self) -> list[float] | None:
        """One log-probability for each of :attr:`reply_ids`; ``None`` where the endpoint gave none."""
        return None if self.logprobs is None else list(_unpack("f", self.logprobs))


def _pack(kind: str, values: Sequence[int] | Sequence[float]) -> bytes:
    packed = array(kind, values)
    if sys.byteorder == "big":
        packed.byteswap()
    return zlib.compress(packed.tobytes(), level=6)


def _unpack(kind: str, packed: bytes) -> array[float]:
    values: array[float] = array(kind)
    values.frombytes(zlib.decompress(packed))
    if sys.byteorder == "big":
        values.byteswap()
    return values
