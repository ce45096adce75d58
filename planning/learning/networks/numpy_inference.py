"""The networks in numpy, for one state at a time: no import of torch (1 s), and no toll on every small operation.

The same arithmetic as `osnet.py` and `rpnet.py`, in float32; a test holds them together. Weights come by torch's names, matrices turned
round when they were loaded, so that x @ W is all there is. Shapes: I queries, J keys, d width, h heads, R numbers a relation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import wraps
from typing import ParamSpec

import numpy as np
from numpy.typing import NDArray

from planning.learning.networks.tokens import F32, Tokens, box_features, pair_features, placed_boxes, token_kinds, with_base_and_hand

Weights = Mapping[str, F32]
P = ParamSpec("P")
_UNFLAGGED = np.errstate(invalid="ignore")
"""BLAS's kernels work on more than an array's own numbers, and seldom leave the flag of an invalid operation behind that is none of the
result's; numpy would warn of it. Whether scores are numbers is looked at by themselves."""


def _scores(forward: Callable[P, F32]) -> Callable[P, F32]:
    """A forward pass whose logits are finite. Raises: ArithmeticError where they are not, which is a fault of the weights or of BLAS."""

    quiet = _UNFLAGGED(forward)

    @wraps(forward)
    def checked(*args: P.args, **kwargs: P.kwargs) -> F32:
        logits = quiet(*args, **kwargs)
        if not np.isfinite(logits).all():
            raise ArithmeticError(f"the network's scores ({forward.__name__}) are not all finite: try other weights (--model)")
        return logits

    return checked


def turned(weights: Mapping[str, NDArray[np.float32]]) -> dict[str, F32]:
    """Weights as torch has them → as they are used here."""
    return {name: np.ascontiguousarray(w.T, np.float32) for name, w in weights.items()}


@dataclass(frozen=True, eq=False)
class Encoding:
    """What RPNet knows of a state before it is asked about an object: Z^e (J, d), the tokens' boxes, keys and values a decoder layer."""

    tokens: Tokens
    z: F32
    places: F32
    keys: tuple[tuple[F32, F32], ...]


@_scores
def osnet(w: Weights, t: Tokens, heads: int) -> F32:
    """Logits of p̂, pickable, opens, first (m, 4); older weights don't know the last."""
    z, _ = _encode(w, t, heads)
    return _mlp(w, "head", z[3:])


@_scores
def paper_osnet(w: Weights, t: Tokens, heads: int) -> F32:
    """Logits of p̂ (m, 1)."""
    x = np.concatenate([_mlp(w, "gamma", t.grasp[None, :9]), _mlp(w, "alpha", np.concatenate([_base(t), t.boxes]))])
    return _mlp(w, "head", _norm(_blocks(w, "encoder", x, heads)[3:]))


@_UNFLAGGED
def rpnet_encode(w: Weights, t: Tokens, heads: int) -> Encoding:
    """The part of RPNet that is the same for every object o' of a state."""
    z, places = _encode(w, t, heads)
    return Encoding(t, z, places, _all_keys(w, z, heads))


@_scores
def rpnet(w: Weights, known: Encoding, moved: int, regions: NDArray[np.intp], heads: int) -> F32:
    """Logits of ĉ, feasible, hits, shorter (I, 4) for the object `moved` (index in the boxes, the target is 0) in some of the regions (I,);
    older weights don't know the last."""
    t = known.tokens
    before = t.boxes[moved]
    after = placed_boxes(np.broadcast_to(before, (len(regions), 6)), t.regions[regions], np)
    features = np.concatenate([box_features(after, t.context, t.grasp, np), after[:, :2] - before[:2]], 1)
    x = _mlp(w, "kappa", features) + _linear(w, "chosen", known.z[moved + 2])
    same = np.zeros((len(regions), len(known.places)), np.float32)
    same[:, moved + 2] = 1
    r = _relate(w, after, known.places, same, t)
    for layer, keys in enumerate(known.keys):
        x = _block(w, f"decoder.{layer}", x, keys, heads, r)
    return _mlp(w, "head", _norm(x))


@_UNFLAGGED
def paper_rpnet_encode(w: Weights, t: Tokens, heads: int) -> Encoding:
    """As `rpnet_encode`, of the printed form; `places` holds κ(l_i) instead."""
    kappa = _mlp(w, "kappa", t.regions)
    alpha = _mlp(w, "alpha", np.concatenate([_base(t), t.boxes[:1]]))
    z = np.concatenate([_mlp(w, "gamma", t.grasp[None, :9]), alpha, kappa])
    z = _norm(_blocks(w, "encoder", z, heads))
    return Encoding(t, z, kappa, _all_keys(w, z, heads))


@_scores
def paper_rpnet(w: Weights, known: Encoding, moved: int, heads: int) -> F32:
    """Logits of ĉ (B,) for every region."""
    x = known.places + _mlp(w, "alpha", known.tokens.boxes[moved])
    for layer, keys in enumerate(known.keys):
        x = _block(w, f"decoder.{layer}", x, keys, heads)
    return _mlp(w, "head", _norm(x))[:, 0]


def sigmoid(x: F32) -> F32:
    """1 / (1 + e^-x)."""
    return np.asarray(1 / (1 + np.exp(-np.clip(x, -60, 60))))


def _encode(w: Weights, t: Tokens, heads: int) -> tuple[F32, F32]:
    """`osnet.Encoder`: (m + 3, d), and the tokens' boxes (m + 3, 6)."""
    objects = _mlp(w, "encode.alpha", box_features(t.boxes, t.context, t.grasp, np))
    objects[0] += w["encode.target"]
    x = np.concatenate([_mlp(w, "encode.base", t.context[None]), _mlp(w, "encode.gamma", t.grasp[None]), objects])
    places = with_base_and_hand(t.boxes, t.context, t.grasp, np)
    r = _relate(w, places, places, np.eye(len(places), dtype=np.float32), t, "encode.relate")
    return _norm(_blocks(w, "encode.encoder", x, heads, r)), places


def _relate(w: Weights, ours: F32, places: F32, same: F32, t: Tokens, name: str = "relate") -> F32:
    pairs = pair_features(ours, places, token_kinds(len(places)), same, t.context, np)
    return np.maximum(_mlp(w, f"{name}.0", pairs.reshape(-1, pairs.shape[-1])), 0).reshape(*pairs.shape[:2], -1)


def _base(t: Tokens) -> F32:
    """The paper's l_r: a box of zero size (1, 6)."""
    return np.concatenate([t.context[:3], np.zeros(3, np.float32)])[None]


def _blocks(w: Weights, name: str, x: F32, heads: int, r: F32 | None = None) -> F32:
    """Self-attention, as many blocks as there are weights for."""
    layer = 0
    while f"{name}.{layer}.attention.q.weight" in w:
        x = _block(w, f"{name}.{layer}", x, None, heads, r)
        layer += 1
    return x


def _block(w: Weights, name: str, x: F32, keys: tuple[F32, F32] | None, heads: int, r: F32 | None = None) -> F32:
    """`layers.Block`; keys: those of the tokens that x attends to, None for its own."""
    y = _norm(x)
    x = x + _attention(w, f"{name}.attention", y, keys or _keys(w, f"{name}.attention", y, heads), heads, r)
    return x + _mlp(w, f"{name}.mlp", _norm(x))


def _attention(w: Weights, name: str, x: F32, keys: tuple[F32, F32], heads: int, r: F32 | None) -> F32:
    k, v = keys
    q = _linear(w, f"{name}.q", x).reshape(len(x), heads, -1).transpose(1, 0, 2)
    logits = q @ k  # (h, I, J)
    if r is not None:
        logits += (r.reshape(-1, r.shape[-1]) @ w[f"{name}.shift.weight"]).reshape(*r.shape[:2], heads).transpose(2, 0, 1)
    logits -= logits.max()  # of all, not of each row: rows differ by far less than float32's exponent spans
    share = np.exp(logits, out=logits)
    share /= (share @ np.ones(share.shape[-1], np.float32))[..., None] + np.float32(1e-30)  # a product is faster than a sum
    heard = (share @ v).transpose(1, 0, 2).reshape(len(x), -1)
    if r is not None:
        heard = np.concatenate([heard, (share.transpose(1, 0, 2) @ r).reshape(len(x), -1)], 1)
    return _linear(w, f"{name}.out", heard)


def _all_keys(w: Weights, z: F32, heads: int) -> tuple[tuple[F32, F32], ...]:
    """The keys and values of z for each decoder layer."""
    layers = sum(name.startswith("decoder.") and name.endswith("attention.q.weight") for name in w)
    return tuple(_keys(w, f"decoder.{layer}.attention", z, heads) for layer in range(layers))


def _keys(w: Weights, name: str, z: F32, heads: int) -> tuple[F32, F32]:
    """Keys, scaled, (h, d / h, J) and values (h, J, d / h)."""
    kv = _linear(w, f"{name}.kv", z).reshape(len(z), 2, heads, -1)
    each = kv.shape[-1]
    return np.ascontiguousarray(kv[:, 0].transpose(1, 2, 0)) / np.float32(each**0.5), np.ascontiguousarray(kv[:, 1].transpose(1, 0, 2))


def _norm(x: F32) -> F32:
    """Layer normalisation over the last axis (torch's epsilon)."""
    x = x - (x @ np.full(x.shape[-1], 1 / x.shape[-1], np.float32))[:, None]
    variance = np.einsum("ij,ij->i", x, x) / np.float32(x.shape[-1])
    x /= np.sqrt(variance + np.float32(1e-5))[:, None]
    return x


def _mlp(w: Weights, name: str, x: F32) -> F32:
    hidden = _linear(w, f"{name}.0", x)
    return _linear(w, f"{name}.2", np.maximum(hidden, np.float32(0), out=hidden))


def _linear(w: Weights, name: str, x: F32) -> F32:
    y: F32 = x @ w[f"{name}.weight"]
    y += w[f"{name}.bias"]
    return y
