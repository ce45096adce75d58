"""RPNet g_φ: what it costs to put the chosen object o' in each region (paper, section III-D).

`PaperRPNet` is as printed: Z^e from α(l_r), γ(x_g), α(o*), κ(l_1..b); the queries α(o') + κ(l_i) attend to Z^e and give ĉ_i. It never sees
the other objects. `RPNet` sees them as tokens, and is asked about a few (o', region) pairs at a time: a pair attends to a dozen tokens,
told how o' would stand to each of them there, and says ĉ, whether o' can be carried there, which share of the paths it would block, and
whether fewer moves are needed then.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from planning.learning.networks.layers import Block, mlp, norm
from planning.learning.networks.osnet import RELATION, Encoder
from planning.learning.networks.tokens import OBJECT, PAIR, box_features, pair_features, placed_boxes, token_kinds, with_base_and_hand


class PaperRPNet(nn.Module):
    """As printed."""

    def __init__(self, width: int = 96, layers: int = 2, heads: int = 4) -> None:
        super().__init__()
        self.alpha = mlp(6, width, width)
        self.gamma = mlp(9, width, width)
        self.kappa = mlp(4, width, width)
        self.encoder = nn.ModuleList(Block(width, heads) for _ in range(layers))
        self.decoder = nn.ModuleList(Block(width, heads) for _ in range(layers))
        self.head = mlp(width, width, 1)

    def forward(self, context: Tensor, grasp: Tensor, boxes: Tensor, regions: Tensor, there: Tensor, moved: Tensor) -> Tensor:
        """context (N, 9), grasp (N, 10), boxes (N, m + 1, 6) target first, regions (N, B, 4), there (N, B) False in the padding.

        moved (N, P): index in boxes of each o' asked about → logits of ĉ (N, P, B).
        """
        kappa = self.kappa(regions)
        alpha = self.alpha(torch.stack([F.pad(context[:, :3], (0, 3)), boxes[:, 0]], 1))
        z = torch.cat([self.gamma(grasp[:, None, :9]), alpha, kappa], 1)
        here = F.pad(there, (3, 0), value=True)
        for block in self.encoder:
            z = block(z, None, here)
        chosen = self.alpha(_take(boxes, moved))
        x = (chosen[:, :, None] + kappa[:, None]).flatten(1, 2)
        z = norm(z)
        for block in self.decoder:
            x = block(x, z, here)
        return self.head(norm(x)).unflatten(1, (moved.shape[1], -1))[..., 0]  # type: ignore[no-any-return]


class RPNet(nn.Module):
    """The `objects` form."""

    def __init__(self, width: int = 96, layers: int = 2, heads: int = 4) -> None:
        super().__init__()
        self.encode = Encoder(width, layers, heads)
        self.kappa = mlp(OBJECT + 2, width, width)
        self.chosen = nn.Linear(width, width)
        self.relate = nn.Sequential(mlp(PAIR, RELATION, RELATION), nn.ReLU())
        self.decoder = nn.ModuleList(Block(width, heads, RELATION) for _ in range(layers))
        self.head = mlp(width, width, 4)

    def forward(self, context: Tensor, grasp: Tensor, boxes: Tensor, mask: Tensor, regions: Tensor, moved: Tensor) -> Tensor:
        """context (N, 9), grasp (N, 10), boxes (N, m + 1, 6) target first, mask (N, m + 1).

        The pairs: regions (N, I, 4) and moved (N, I), the index in boxes of o' → logits of ĉ, feasible, hits, shorter (N, I, 4).
        """
        z = self.encode(context, grasp, boxes, mask)
        places = with_base_and_hand(boxes, context, grasp, torch)
        before = _take(boxes, moved)
        after = placed_boxes(before, regions, torch)
        features = [box_features(after, context, grasp, torch), after[..., :2] - before[..., :2]]
        x = self.kappa(torch.cat(features, -1)) + self.chosen(_take(z, moved + 2))
        kinds = torch.from_numpy(token_kinds(places.shape[1])).to(z)
        same = F.one_hot(moved + 2, places.shape[1]).to(z)
        r = self.relate(pair_features(after, places, kinds, same, context, torch))
        here = F.pad(mask, (2, 0), value=True)
        for block in self.decoder:
            x = block(x, z, here, r)
        return self.head(norm(x))  # type: ignore[no-any-return]


def _take(x: Tensor, index: Tensor) -> Tensor:
    """x (N, n, d) at index (N, k) → (N, k, d)."""
    return x.gather(1, index[..., None].expand(-1, -1, x.shape[-1]))
