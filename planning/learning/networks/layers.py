"""The parts of both networks: two-layer perceptrons, and Transformer blocks (Vaswani et al., 2017; pre-norm, ReLU, no dropout).

Shapes: … batch axes, I queries, J keys, d width, h heads, R numbers a relation. `numpy_inference.py` is the same in numpy.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F


def mlp(inputs: int, hidden: int, outputs: int) -> nn.Sequential:
    """Linear, ReLU, Linear."""
    return nn.Sequential(nn.Linear(inputs, hidden), nn.ReLU(), nn.Linear(hidden, outputs))


def norm(x: Tensor) -> Tensor:
    """Layer normalisation without weights: a linear layer follows everywhere, which has them."""
    return F.layer_norm(x, x.shape[-1:])


class Attention(nn.Module):
    """Multi-head attention; with relations r_ij, they shift the logits and are averaged along with the values.

    So a query hears *how* it stands to what it looks at, and the cost stays that of R numbers a pair.
    """

    def __init__(self, width: int, heads: int, relation: int = 0) -> None:
        super().__init__()
        self.heads = heads
        self.q = nn.Linear(width, width)
        self.kv = nn.Linear(width, 2 * width)
        self.shift = nn.Linear(relation, heads, bias=False) if relation else None
        self.out = nn.Linear(width + heads * relation, width)

    def forward(self, x: Tensor, z: Tensor, mask: Tensor | None, r: Tensor | None) -> Tensor:
        """x (…, I, d) asks z (…, J, d); mask (…, J) True for tokens that are there; r (…, I, J, R) → (…, I, d)."""
        q = self.q(x).unflatten(-1, (self.heads, -1)).transpose(-2, -3)  # (…, h, I, d / h)
        k, v = (t.unflatten(-1, (self.heads, -1)).transpose(-2, -3) for t in self.kv(z).chunk(2, -1))
        logits = q @ k.transpose(-1, -2) / q.shape[-1] ** 0.5  # (…, h, I, J)
        if self.shift is not None and r is not None:
            logits = logits + self.shift(r).movedim(-1, -3)
        if mask is not None:
            logits = logits.masked_fill(~mask[..., None, None, :], -1e9)
        share = logits.softmax(-1)
        heard = (share @ v).transpose(-2, -3).flatten(-2)
        if r is not None:
            heard = torch.cat([heard, (share.transpose(-2, -3) @ r).flatten(-2)], -1)  # (…, I, h, J) @ (…, I, J, R)
        return self.out(heard)  # type: ignore[no-any-return]


class Block(nn.Module):
    """Attention and a perceptron, each added to what came in. Without z, x attends to itself."""

    def __init__(self, width: int, heads: int, relation: int = 0) -> None:
        super().__init__()
        self.attention = Attention(width, heads, relation)
        self.mlp = mlp(width, 2 * width, width)

    def forward(self, x: Tensor, z: Tensor | None, mask: Tensor | None, r: Tensor | None = None) -> Tensor:
        y = norm(x)
        x = x + self.attention(y, y if z is None else z, mask, r)
        return x + self.mlp(norm(x))  # type: ignore[no-any-return]
