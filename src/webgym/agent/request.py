"""Builds the request that an endpoint receives, also from a stored step.

A step stores its messages, with pictures by name and size, and the sampling parameters that were sent. With
the stored screenshots that is the complete request: training rebuilds exactly the same bytes and tokens.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from webgym.agent.image_codec import fit, media_type
from webgym.core.trajectory import ImageRef, Message, Step, TextPart


def to_openai(messages: Sequence[Message], images: Mapping[str, bytes]) -> list[dict[str, Any]]:
    """Messages in the form of the OpenAI chat API, with pictures as ``data:`` URLs.

    The content of a message without pictures is a plain string, which every chat template supports.

    Args:
        messages: the messages of a request.
        images: its pictures by name, encoded, at the size at which they are sent.
    """
    return [{"role": message.role, "content": _content(message, images)} for message in messages]


def request_of(step: Step, model: str, picture: Callable[[str], bytes]) -> dict[str, Any]:
    """The body of the request that a stored step is the reply to, with its fields in the order sent.

    Args:
        step: a step from the run store.
        model: name of the model in the request (``Episode.policy``).
        picture: returns a stored screenshot by its name, e.g. ``RunReader(run).image``.

    Raises:
        ProtocolError: a stored screenshot cannot be read as a picture.
    """
    parts = (part for message in step.messages for part in message.content)
    sizes = {part.screenshot: (part.width, part.height) for part in parts if isinstance(part, ImageRef)}
    images = {name: fit(picture(name), size) for name, size in sizes.items()}
    body = {"model": model, "messages": to_openai(step.messages, images), "stream": False}
    return dict(sorted((body | step.reply.sampling).items()))


def _content(message: Message, images: Mapping[str, bytes]) -> str | list[dict[str, Any]]:
    if all(isinstance(part, TextPart) for part in message.content):
        return "".join(part.text for part in message.content if isinstance(part, TextPart))
    return [_part(part, images) for part in message.content]


def _part(part: TextPart | ImageRef, images: Mapping[str, bytes]) -> dict[str, Any]:
    if isinstance(part, TextPart):
        return {"type": "text", "text": part.text}
    data = images[part.screenshot]
    url = f"data:{media_type(data)};base64,{base64.b64encode(data).decode()}"
    return {"type": "image_url", "image_url": {"url": url} | ({"detail": part.detail} if part.detail else {})}
