"""Training of one network: AdamW, a warm-up and a cosine, early stopping; an epoch's end is a checkpoint to go on from, bit for bit.

All randomness comes from (seed, `STAGE`, network, epoch), so the state of a run is its weights, the optimizer's numbers and the epoch.
The same bits come out again on the same kind of machine with the same number of threads.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from planning.learning.networks.model import NETS
from planning.learning.networks.osnet import OSNet, PaperOSNet
from planning.learning.networks.rpnet import PaperRPNet, RPNet
from planning.learning.training.batches import Batch, osnet_batch, rpnet_batch, usable
from planning.learning.training.dataset import Data
from planning.learning.training.settings import Settings

STAGE = 5  # this stage's word in the seeds of random generators
VALIDATE_ON = 2000  # states of the validation split, at most, that are looked at after each epoch


@dataclass(frozen=True)
class Epoch:
    """The losses of one epoch, averaged over its steps, and on the validation split; whether that is the best so far."""

    number: int
    train: float
    validation: float
    best: bool


@dataclass(frozen=True, eq=False)
class Trained:
    """The weights of the best epoch, and the losses of all."""

    weights: dict[str, Tensor]
    epochs: tuple[Epoch, ...]
    best: int


Begin = Mapping[str, NDArray[np.float32]]
"""Weights that a run begins with, by torch's names."""


def make_net(name: str, settings: Settings, begin: Begin | None = None) -> nn.Module:
    """osnet or rpnet, with first weights from the seed, or with those of another run; heads that those don't have are from the seed.

    Raises: ValueError for weights of networks of another size or form.
    """
    net = _random_net(name, settings)
    if begin is None:
        return net
    first = net.state_dict()
    for key in sorted(set(first) | set(begin)):
        ours, theirs = (tuple(w[key].shape) if key in w else None for w in (first, begin))
        head = key.startswith("head.2.") and ours is not None and theirs is not None and ours[1:] == theirs[1:] and ours[0] >= theirs[0]
        if ours != theirs and not head:
            raise ValueError(f"{name}: {key}: the networks to begin with have {theirs or 'none'}, and these have {ours or 'none'}")
        first[key][: len(begin[key])] = torch.from_numpy(np.ascontiguousarray(begin[key]))
    net.load_state_dict(first)
    return net


def _random_net(name: str, settings: Settings) -> nn.Module:
    paper = settings.form == "paper"
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(np.random.default_rng([settings.seed, STAGE, NETS.index(name)]).integers(2**31)))
        if name == "osnet":
            return (PaperOSNet if paper else OSNet)(settings.width, settings.layers, settings.heads)
        return (PaperRPNet if paper else RPNet)(settings.width, max(1, settings.layers - 1), settings.heads)


def train(
    name: str,
    data: Data,
    held_out: Data,
    settings: Settings,
    *,
    begin: Begin | None = None,
    device: str = "cpu",
    checkpoint: Path | None = None,
    on_epoch: Callable[[Epoch], None] = lambda _: None,
    on_step: Callable[[int, int], None] = lambda done, of: None,
) -> Trained:
    """Train osnet or rpnet on `data`; `held_out` decides which epoch was best and when to stop.

    begin: weights to begin with. checkpoint: a file that is written after each epoch; when it is there already, the run goes on behind it.
    on_step: steps done, of how many in an epoch. Raises: ValueError when the checkpoint is of another run, the weights to begin with are of
    other networks, or no state has what this network learns from.
    """
    torch.set_num_threads(settings.threads)
    make = osnet_batch if name == "osnet" else rpnet_batch
    states = usable(name, data)
    checked = usable(name, held_out)[:VALIDATE_ON]
    for what, found in (("training", states), ("validation", checked)):
        if len(found) == 0:
            raise ValueError(f"no state for {what} says what {name} learns from; label more scenes")
    net = make_net(name, settings, begin).to(device)
    optimizer = torch.optim.AdamW(net.parameters(), lr=settings.lr, weight_decay=settings.weight_decay)
    best = {k: v.detach().clone() for k, v in net.state_dict().items()}
    done: list[Epoch] = []
    if checkpoint is not None and checkpoint.is_file():
        best, done = _resume(checkpoint, net, optimizer, settings)
    steps = -(-len(states) // settings.batch)
    while not finished(done, settings):
        number = len(done)
        rng = np.random.default_rng([settings.seed, STAGE, NETS.index(name), number])
        order, losses = states[rng.permutation(len(states))], []
        net.train()
        for step, first in enumerate(range(0, len(order), settings.batch)):
            share = (number * steps + step) / (settings.epochs * steps)
            for group in optimizer.param_groups:
                group["lr"] = settings.lr * _pace(share, settings.warmup)
            value = loss(net, make(data, order[first : first + settings.batch], settings, rng), device)
            optimizer.zero_grad(set_to_none=True)
            value.backward()  # type: ignore[no-untyped-call]
            nn.utils.clip_grad_norm_(net.parameters(), 1.0)
            optimizer.step()
            losses.append(value.detach())
            on_step(step + 1, steps)
        validation = _validate(net, name, held_out, checked, settings, device)
        epoch = Epoch(number, float(torch.stack(losses).mean()), validation, not done or validation < min(e.validation for e in done))
        done.append(epoch)
        if epoch.best:
            best = {k: v.detach().clone() for k, v in net.state_dict().items()}
        if checkpoint is not None:
            _save(checkpoint, net, optimizer, best, done, settings)
        on_epoch(epoch)
    return Trained({k: v.cpu() for k, v in best.items()}, tuple(done), max(e.number for e in done if e.best))


def loss(net: nn.Module, batch: Batch, device: str) -> Tensor:
    """The sum of the heads' losses: squared error of p̂ and ĉ, as in the paper; cross entropy of chances and shares. NaN is unknown."""
    inputs = [torch.from_numpy(a).to(device) for a in batch.inputs]
    out = net(*inputs)
    wanted = [torch.from_numpy(a).to(device) for a in batch.wanted]
    total: Tensor = out.new_zeros(())
    for head, (target, weight) in enumerate(zip(wanted, batch.weights)):
        known = ~target.isnan()
        logit = (out[..., head] if batch.heads else out)[known]
        target = target[known]
        if len(target) == 0:
            continue
        if head == 0:
            total = total + weight * (logit.sigmoid() - target).square().mean()
        else:
            total = total + weight * nn.functional.binary_cross_entropy_with_logits(logit, target)
    return total


def finished(done: list[Epoch], settings: Settings) -> bool:
    """Whether all epochs are done, or none of the last few was better."""
    since = len(done) - 1 - max((e.number for e in done if e.best), default=-1)
    return len(done) >= settings.epochs or since >= settings.patience


@torch.no_grad()
def _validate(net: nn.Module, name: str, data: Data, states: NDArray[np.intp], settings: Settings, device: str) -> float:
    """The loss on the validation split; the same pairs are asked about after every epoch."""
    net.eval()
    rng = np.random.default_rng([settings.seed, STAGE, NETS.index(name), 2**31])
    make = osnet_batch if name == "osnet" else rpnet_batch
    values, sizes = [], []
    for first in range(0, len(states), settings.batch):
        index = states[first : first + settings.batch]
        values.append(float(loss(net, make(data, index, settings, rng), device)))
        sizes.append(len(index))
    return float(np.average(values, weights=sizes))


def _pace(share: float, warmup: float) -> float:
    """The learning rate's factor when `share` of all steps is done."""
    if share < warmup:
        return (share + 1e-3) / (warmup + 1e-3)
    return float(0.01 + 0.99 * 0.5 * (1 + np.cos(np.pi * (share - warmup) / (1 - warmup))))


# Checkpoints ----------------------------------------------------------------------------------------------------------------------------


def _save(
    file: Path, net: nn.Module, optimizer: torch.optim.Optimizer, best: dict[str, Tensor], done: list[Epoch], settings: Settings
) -> None:
    tensors = {f"net.{k}": v for k, v in net.state_dict().items()} | {f"best.{k}": v for k, v in best.items()}
    for i, numbers in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{i}.{k}": torch.as_tensor(v) for k, v in numbers.items()}
    metadata = {"settings": json.dumps(asdict(settings)), "epochs": json.dumps([asdict(e) for e in done])}
    part = file.with_name(file.stem + ".part" + file.suffix)
    save_file({k: v.detach().contiguous().cpu() for k, v in tensors.items()}, part, metadata)
    os.replace(part, file)


def _resume(file: Path, net: nn.Module, optimizer: torch.optim.Optimizer, settings: Settings) -> tuple[dict[str, Tensor], list[Epoch]]:
    try:
        with safe_open(file, "pt") as f:
            tensors = {k: f.get_tensor(k) for k in f.keys()}  # noqa: SIM118  (it is no dict)
            metadata = f.metadata() or {}
        saved = dict(json.loads(metadata["settings"]))
        epochs = [Epoch(**e) for e in json.loads(metadata["epochs"])]
    except (SafetensorError, KeyError, TypeError, ValueError, RecursionError) as e:
        raise ValueError(f"{file}: is no checkpoint, or a damaged one ({type(e).__name__}: {e}); remove it to begin anew") from e
    for key, value in asdict(settings).items():
        if saved.get(key) != value:
            raise ValueError(
                f"{file}: that run has {key} = {saved.get(key)}, not {value}; resume with the same options, or begin elsewhere"
            )

    def under(prefix: str) -> dict[str, Any]:
        return {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}

    net.load_state_dict(under("net."))
    state = optimizer.state_dict()
    state["state"] = {i: under(f"optimizer.{i}.") for i in range(len(state["param_groups"][0]["params"]))}
    optimizer.load_state_dict(state)
    return under("best."), epochs
