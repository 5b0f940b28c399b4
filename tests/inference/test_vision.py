"""The quicker vision tower computes the same numbers, gradients included."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

torch = pytest.importorskip("torch")

from webgym.inference.model import fast_backward_attention  # noqa: E402


def speed_up(model: Any) -> None:
    from webgym.inference.vision import speed_up_vision  # imports transformers' models

    speed_up_vision(model)


EQUAL, UNEQUAL = [[1, 4, 6], [1, 4, 6]], [[1, 4, 6], [1, 2, 4]]


def test_a_patch_embedding_gives_the_same_as_product_and_as_convolution() -> None:
    torch.manual_seed(0)
    size = (2, 4, 4)
    plain = torch.nn.Sequential(torch.nn.Conv3d(3, 8, kernel_size=size, stride=size))
    quick = torch.nn.Sequential(torch.nn.Conv3d(3, 8, kernel_size=size, stride=size))
    quick.load_state_dict(plain.state_dict())
    speed_up(quick)
    assert list(quick.state_dict()) == list(plain.state_dict())
    patches = torch.randn(5, 3, *size)
    made = [model(patches) for model in (plain, quick)]
    assert type(quick[0]) is not torch.nn.Conv3d
    torch.testing.assert_close(made[1], made[0])
    for each in made:
        each.square().sum().backward()
    torch.testing.assert_close(quick[0].weight.grad, plain[0].weight.grad)
    volume = torch.randn(1, 3, 4, 8, 8)  # more than a patch at a time is convolved as ever
    torch.testing.assert_close(quick(volume), plain(volume))


@pytest.mark.parametrize("pictures", [EQUAL, UNEQUAL])
def test_pictures_are_attended_to_together(pictures: list[list[int]]) -> None:
    from transformers import Qwen3VLVisionConfig, Qwen3VLVisionModel

    def made() -> Iterator[Any]:
        for _ in range(2):
            torch.manual_seed(0)
            yield Qwen3VLVisionModel(
                Qwen3VLVisionConfig(
                    depth=2,
                    hidden_size=32,
                    intermediate_size=64,
                    num_heads=2,
                    patch_size=4,
                    out_hidden_size=32,
                    num_position_embeddings=64,
                    deepstack_visual_indexes=[0],
                )
            )

    plain, quick = made()
    speed_up(quick)
    layers = [type(module).__name__ for module in quick.modules()]
    assert "_BatchedVisionAttention" in layers
    assert "Qwen3VLVisionAttention" not in layers
    grid = torch.tensor(pictures)
    patches = torch.randn(int(grid.prod(1).sum()), 3 * 2 * 4 * 4)
    seen = [plain(patches, grid_thw=grid)]
    with fast_backward_attention("cpu"):
        seen.append(quick(patches, grid_thw=grid))
    torch.testing.assert_close(seen[1].pooler_output, seen[0].pooler_output)
    for each in seen:
        each.pooler_output.square().sum().backward()
    for ours, theirs in zip(quick.parameters(), plain.parameters(), strict=True):
        torch.testing.assert_close(ours.grad, theirs.grad, rtol=1e-4, atol=1e-5)
