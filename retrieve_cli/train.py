"""`retrieve train`: labels become a model folder, with the loss curves on the terminal and beside the weights."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinematics.errors import InputError, blame
from planning.io.outputs import alone_in, replacing, write_text
from retrieve_cli.errors import Ended
from retrieve_cli.terminal import say

if TYPE_CHECKING:
    from planning.learning.training.dataset import Data
    from planning.learning.training.settings import Settings
    from planning.learning.training.train import Begin, Epoch, Trained

VALIDATION_SHARE = 0.1  # of the scenes


def run(
    *,
    labels: Sequence[Path],
    out: Path,
    form: str,
    epochs: int,
    width: int,
    batch: int,
    learning_rate: float,
    seed: int,
    threads: int | None,
    device: str,
    resume: bool,
    begin: Path | None = None,
) -> None:
    """Train both networks and write the model folder. A run that was broken off leaves OUT/checkpoint, and goes on from there."""
    import torch

    from planning.learning.training import dataset
    from planning.learning.training.settings import Settings

    where = "cuda" if device == "auto" and torch.cuda.is_available() else {"auto": "cpu"}.get(device, device)
    if where == "cuda" and not torch.cuda.is_available():
        raise InputError("train: --device cuda: PyTorch finds no CUDA device here; leave the option out to train on the processor")
    if width % 4:
        raise InputError(f"train: --width: {width} is no multiple of 4, the number of attention heads")
    with blame("train"):
        data, manifest = dataset.read_all(labels)
        rest, held_out = (data.take(index) for index in dataset.split(data.scene, VALIDATION_SHARE))
    if out.resolve() in [folder.resolve() for folder in labels]:
        raise InputError(f"train: {out}: holds the labels; name another folder for the model with -o")
    _refuse_to_overwrite(out, resume)
    first = None if begin is None else _first_weights(begin, form)
    settings = Settings(
        form=form, epochs=epochs, width=width, batch=batch, lr=learning_rate, seed=seed, threads=threads or torch.get_num_threads(),
        began_with=None if first is None else _digest(first),
    )  # fmt: skip
    with alone_in(out):
        (out / "checkpoint").mkdir(exist_ok=True)
        say(f"{len(rest)} states to train on, {len(held_out)} to validate on, of {len(set(data.scene))} scenes; {form} form, on {where}")
        try:
            results, metrics = _train(rest, held_out, settings, first, out / "checkpoint", manifest["hash"], where)
        except (KeyboardInterrupt, Ended):
            say(f"{out}: broken off; the same call with --resume goes on there")
            raise
        _write_model(out, results, settings, manifest, metrics, (len(rest), len(held_out)))
    _show_metrics(metrics)


def _train(
    rest: Data, held_out: Data, settings: Settings, first: Mapping[str, Begin] | None, folder: Path, digest: str, where: str
) -> tuple[dict[str, Trained], dict[str, dict[str, float]]]:
    """Both networks trained, and how good they are on what was held out. first: weights to begin with; folder: where a run that is
    broken off leaves its state; digest: of the labels; where: the device."""
    from planning.learning.networks.model import NETS
    from planning.learning.training.evaluate import judge_osnet, judge_rpnet
    from planning.learning.training.train import make_net, train

    results: dict[str, Trained] = {}
    metrics: dict[str, dict[str, float]] = {}
    for name in NETS:
        _same_labels(folder, digest)
        with blame("train"), _epochs(name, settings.epochs) as (on_epoch, on_step):
            results[name] = train(
                name, rest, held_out, settings, begin=None if first is None else first[name],
                device=where, checkpoint=folder / f"{name}.safetensors", on_epoch=on_epoch, on_step=on_step,
            )  # fmt: skip
        net = make_net(name, settings)
        net.load_state_dict(results[name].weights)
        metrics[name] = (judge_osnet if name == "osnet" else judge_rpnet)(net, held_out, settings)
    return results, metrics


def _first_weights(folder: Path, form: str) -> dict[str, Begin]:
    """The weights of a model to begin with. Raises: InputError for a folder that is none, or networks of the other form."""
    from planning.learning.networks.model import from_pretrained

    with blame("train: --from"):
        model = from_pretrained(folder)
    if model.form != form:
        raise InputError(f"train: --from: {folder}: networks of the form {model.form}; train those with --form {model.form}")
    nets = {"osnet": model.osnet, "rpnet": model.rpnet}
    return {name: {key: w.T for key, w in weights.items()} for name, weights in nets.items()}  # as torch has them


def _digest(weights: Mapping[str, Begin]) -> str:
    digest = hashlib.sha256()
    for name, tensors in sorted(weights.items()):
        for key, w in sorted(tensors.items()):
            digest.update(f"{name}.{key}".encode() + w.tobytes())
    return digest.hexdigest()[:16]


def _refuse_to_overwrite(out: Path, resume: bool) -> None:
    """Raises: InputError where the folder holds hours of somebody's processor, or nothing to go on with."""
    checkpoint = out / "checkpoint"
    begun = checkpoint.is_dir() and any(checkpoint.iterdir())
    if begun and not resume:
        with alone_in(out):  # else another run is in it
            raise InputError(f"{out}: holds a run that was broken off; go on with --resume, or choose another folder")
    if resume and not begun:
        done = (out / "config.json").is_file()
        raise InputError(f"{out}: {'this model is finished' if done else 'there is no run'}, nothing to resume; leave --resume out")
    if (out / "config.json").is_file() and not begun:
        raise InputError(f"{out}: holds a model already; choose another folder, or remove it first")


def _same_labels(checkpoint: Path, digest: str) -> None:
    note = checkpoint / "labels.json"
    if not note.is_file():
        write_text(note, json.dumps({"hash": digest}) + "\n")
    elif json.loads(note.read_text(encoding="utf-8")).get("hash") != digest:
        raise InputError(f"{checkpoint}: the labels have changed since that run began; begin a new one in another folder")


def _write_model(
    out: Path, results: dict[str, Trained], settings: Settings, manifest: dict[str, Any], metrics: dict[str, Any], states: tuple[int, int]
) -> None:
    """The weights, the curves, and config.json last: a folder that has it is whole."""
    import shutil
    from dataclasses import asdict
    from importlib.metadata import version as installed

    from safetensors.torch import save

    from planning.learning.networks.model import describe
    from retrieve_cli.version import version

    shapes = {}
    for name, result in results.items():
        with replacing(out / f"{name}.safetensors") as part:
            part.write_bytes(save({k: v.contiguous() for k, v in result.weights.items()}))
        shapes[name] = {k: list(v.shape) for k, v in sorted(result.weights.items())}
    _draw_curves(out / "loss.png", results)
    about = {
        "settings": asdict(settings),
        "data": {
            "hash": manifest["hash"],
            "source": manifest.get("source", manifest.get("spec")),
            "train": states[0],
            "validation": states[1],
        },
        "best_epoch": {name: result.best for name, result in results.items()},
        "loss": {name: [[e.train, e.validation] for e in result.epochs] for name, result in results.items()},
        "metrics": metrics,
        "versions": {"retrieve": version(), **{p: installed(p) for p in ("torch", "numpy", "safetensors")}},
    }
    config = describe(settings.form, settings.heads, shapes, manifest["robot"], about)
    write_text(out / "config.json", json.dumps(_without_nan(config), indent=1) + "\n")
    shutil.rmtree(out / "checkpoint")


def _without_nan(value: Any) -> Any:
    """JSON knows no NaN: null stands for a share of nothing."""
    if isinstance(value, dict):
        return {k: _without_nan(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(v) for v in value]
    return None if isinstance(value, float) and value != value else value


# What the user sees ---------------------------------------------------------------------------------------------------------------------


@contextmanager
def _epochs(name: str, total: int) -> Iterator[tuple[Callable[[Epoch], None], Callable[[int, int], None]]]:
    """A line an epoch, and on a terminal a bar below, with the curve of the validation loss."""
    seen: list[float] = []

    def line(epoch: Epoch) -> str:
        seen.append(epoch.validation)
        mark = "  best so far" if epoch.best else ""
        return f"{name} epoch {epoch.number + 1:3d}/{total}  loss {epoch.train:.4f}  validation {epoch.validation:.4f}{mark}"

    if not sys.stderr.isatty():
        yield lambda epoch: say(line(epoch)), lambda done, of: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[curve]}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(file=sys.stderr, highlight=False), transient=True) as bar:
        task = bar.add_task(name, total=total, curve="")

        def on_epoch(epoch: Epoch) -> None:
            bar.console.print(line(epoch))
            bar.update(task, completed=epoch.number + 1, curve=sparkline(seen))

        yield on_epoch, lambda done, of: bar.update(task, completed=len(seen) + done / of)


def sparkline(values: Sequence[float], width: int = 40) -> str:
    """A curve in one line of text: the last `width` values between their least and largest."""
    blocks, shown = "▁▂▃▄▅▆▇█", list(values)[-width:]
    low, high = min(shown), max(shown)
    return "".join(blocks[round((v - low) / (high - low) * (len(blocks) - 1))] if high > low else blocks[0] for v in shown)


def _show_metrics(metrics: dict[str, dict[str, float]]) -> None:
    from rich import box
    from rich.table import Table

    from retrieve_cli.terminal import show

    table = Table("network", "on validation scenes", "value", box=box.SIMPLE_HEAD)
    for name, values in metrics.items():
        for i, (what, value) in enumerate(values.items()):
            table.add_row(
                name if i == 0 else "", what.replace("_", " "), f"{value:.0f}" if what in ("states", "objects") else f"{value:.3f}"
            )
    show(table)


def _draw_curves(out: Path, results: dict[str, Trained]) -> None:
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, len(results), figsize=(4.5 * len(results), 3.2), layout="constrained")
    for axis, (name, result) in zip(axes, results.items()):
        numbers = [e.number + 1 for e in result.epochs]
        axis.plot(numbers, [e.train for e in result.epochs], label="training")
        axis.plot(numbers, [e.validation for e in result.epochs], label="validation")
        axis.axvline(result.best + 1, color="0.8", zorder=0)
        axis.set(title=name, xlabel="epoch", ylabel="loss")
        axis.legend(frameon=False)
    with replacing(out) as part:
        figure.savefig(part, dpi=120)
    plt.close(figure)
