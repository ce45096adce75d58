"""What a run of training depends on, besides its data."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """layers: of OSNet's encoder, RPNet's encoder and RPNet's decoder have one fewer each."""

    form: str = "objects"
    epochs: int = 30
    patience: int = 10  # epochs without a better validation loss after which a run ends
    width: int = 96
    layers: int = 3
    heads: int = 4
    batch: int = 128  # states
    pairs: int = 48  # (object, region) pairs of a state in a step, `objects` form
    lr: float = 1.5e-3
    weight_decay: float = 0.02
    warmup: float = 0.03  # share of all steps
    seed: int = 0
    threads: int = 1
    began_with: str | None = None  # a hash of the weights that the run began with, if not with random ones
