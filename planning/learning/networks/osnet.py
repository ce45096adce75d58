"""OSNet f_θ: which object blocks the homotopy of paths to the target (paper, section III-C).

`PaperOSNet` is as printed: α embeds l_r and all m + 1 objects, γ embeds x_g; the m + 3 tokens attend to each other; the outputs of the m
non-target objects give p̂. `OSNet` is told more (`tokens.box_features`, `tokens.pair_features`) and says more.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from planning.learning.networks.layers import Block, mlp, norm
from planning.learning.networks.tokens import CONTEXT, GRASP, OBJECT, PAIR, box_features, pair_features, token_kinds, with_base_and_hand

RELATION = 24


class PaperOSNet(nn.Module):
    """As printed. The target has no mark of its own: x_g tells which it is."""

    def __init__(self, width: int = 96, layers: int = 3, heads: int = 4) -> None:
        super().__init__()
        self.alpha = mlp(6, width, width)
        self.gamma = mlp(9, width, width)
        self.encoder = nn.ModuleList(Block(width, heads) for _ in range(layers))
        self.head = mlp(width, width, 1)

    def forward(self, context: Tensor, grasp: Tensor, boxes: Tensor, mask: Tensor) -> Tensor:
        """context (N, 9), grasp (N, 10), boxes (N, m + 1, 6) target first, mask (N, m + 1) → logits of p̂ (N, m, 1)."""
        base = F.pad(context[:, None, :3], (0, 3))
        x = torch.cat([self.gamma(grasp[:, None, :9]), self.alpha(torch.cat([base, boxes], 1))], 1)
        here = F.pad(mask, (2, 0), value=True)
        for block in self.encoder:
            x = block(x, None, here)
        return self.head(norm(x[:, 3:]))  # type: ignore[no-any-return]


class OSNet(nn.Module):
    """The `objects` form: four heads, p̂, can it be picked now, is the target free once it is gone, and does it go first in a shortest
    relaxed plan."""

    def __init__(self, width: int = 96, layers: int = 3, heads: int = 4) -> None:
        super().__init__()
        self.encode = Encoder(width, layers, heads)
        self.head = mlp(width, width, 4)

    def forward(self, context: Tensor, grasp: Tensor, boxes: Tensor, mask: Tensor) -> Tensor:
        """Inputs as for `PaperOSNet` → logits of p̂, pickable, opens, first (N, m, 4)."""
        return self.head(self.encode(context, grasp, boxes, mask)[:, 3:])  # type: ignore[no-any-return]


class Encoder(nn.Module):
    """Context, x_g and objects attend to each other, told how they stand to each other: (N, m + 3, d), normalised."""

    def __init__(self, width: int, layers: int, heads: int) -> None:
        super().__init__()
        self.base = mlp(CONTEXT, width, width)
        self.gamma = mlp(GRASP, width, width)
        self.alpha = mlp(OBJECT, width, width)
        self.target = nn.Parameter(torch.zeros(width))
        self.relate = nn.Sequential(mlp(PAIR, RELATION, RELATION), nn.ReLU())
        self.encoder = nn.ModuleList(Block(width, heads, RELATION) for _ in range(layers))

    def forward(self, context: Tensor, grasp: Tensor, boxes: Tensor, mask: Tensor) -> Tensor:
        objects = self.alpha(box_features(boxes, context, grasp, torch))
        objects = torch.cat([objects[:, :1] + self.target, objects[:, 1:]], 1)
        x = torch.cat([self.base(context)[:, None], self.gamma(grasp)[:, None], objects], 1)
        places = with_base_and_hand(boxes, context, grasp, torch)
        n = places.shape[1]
        kinds, same = torch.from_numpy(token_kinds(n)).to(x), torch.eye(n).to(x).expand(len(x), n, n)
        r = self.relate(pair_features(places, places, kinds, same, context, torch))
        here = F.pad(mask, (2, 0), value=True)
        for block in self.encoder:
            x = block(x, None, here, r)
        return norm(x)
