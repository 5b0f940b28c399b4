"""Patches are embedded by a matrix product: the same numbers as the convolution, gradients included."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")

from webgym.inference.model import multiply_patches  # noqa: E402


def test_a_patch_embedding_gives_the_same_as_product_and_as_convolution() -> None:
    torch.manual_seed(0)
    size = (2, 4, 4)
    plain = torch.nn.Sequential(torch.nn.Conv3d(3, 8, kernel_size=size, stride=size))
    quick = torch.nn.Sequential(torch.nn.Conv3d(3, 8, kernel_size=size, stride=size))
    quick.load_state_dict(plain.state_dict())
    multiply_patches(quick)
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
