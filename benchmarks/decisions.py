"""How long a decision takes: both networks for one state, in numpy as `retrieve plan` runs them, and in torch as they are trained.

    python benchmarks/decisions.py [--width 96] [--objects 8] [--regions 100] [--threads 1]

A scene costs one `select` a move and one `place` for each object that is tried; `place` reads the state once, then asks for each object.
Times are medians in ms of processor time, so that a busy machine does not count.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

arguments = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
arguments.add_argument("--width", type=int, default=96)
arguments.add_argument("--objects", type=int, default=8, help="non-target objects")
arguments.add_argument("--regions", type=int, default=100)
arguments.add_argument("--threads", type=int, default=1)
asked = arguments.parse_args()
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = str(asked.threads)  # before numpy is imported

import numpy as np  # noqa: E402
import torch  # noqa: E402

from planning.learning import numpy_inference  # noqa: E402
from planning.learning.networks.tokens import Tokens  # noqa: E402
from planning.learning.training.settings import Settings  # noqa: E402
from planning.learning.training.train import make_net  # noqa: E402


def median_ms(run: Callable[[], object], times: int = 300) -> float:
    """Of processor time, after ten runs to warm up."""
    spent = []
    for i in range(times + 10):
        begin = time.process_time()
        run()
        if i >= 10:
            spent.append(time.process_time() - begin)
    return 1e3 * float(np.median(spent))


def measure(form: str, t: Tokens) -> None:
    """Print the lines of one form."""
    settings, every = Settings(form=form, width=asked.width), np.arange(len(t.regions))
    paper, heads = form == "paper", settings.heads
    nets = {name: make_net(name, settings).eval() for name in ("osnet", "rpnet")}
    w = {name: numpy_inference.turned({k: v.numpy() for k, v in net.state_dict().items()}) for name, net in nets.items()}
    scene = [torch.from_numpy(a)[None] for a in (t.context, t.grasp, t.boxes)]
    regions, mask = torch.from_numpy(t.regions)[None], torch.ones(1, len(t.boxes), dtype=torch.bool)
    there, first, all_first = (
        torch.ones(regions.shape[:2], dtype=torch.bool),
        torch.tensor([[1]]),
        torch.ones(1, len(every), dtype=torch.int64),
    )
    select = numpy_inference.paper_osnet if paper else numpy_inference.osnet
    encode = numpy_inference.paper_rpnet_encode if paper else numpy_inference.rpnet_encode
    known = encode(w["rpnet"], t, heads)

    def place() -> object:
        return (
            numpy_inference.paper_rpnet(w["rpnet"], known, 1, heads) if paper else numpy_inference.rpnet(w["rpnet"], known, 1, every, heads)
        )

    def in_torch() -> object:
        return nets["rpnet"](*scene, regions, there, first) if paper else nets["rpnet"](*scene, mask, regions, all_first)

    with torch.inference_mode():
        chosen, theirs = median_ms(lambda: select(w["osnet"], t, heads)), median_ms(lambda: nets["osnet"](*scene, mask))
        read, placed, both = median_ms(lambda: encode(w["rpnet"], t, heads)), median_ms(place), median_ms(in_torch)
    sizes = [sum(v.size for v in w[name].values()) for name in ("osnet", "rpnet")]
    print(f"{form:8} {'osnet: select':34} {sizes[0]:9d} {chosen:7.2f} {theirs:7.2f}")
    print(f"{form:8} {'rpnet: read the state + place one':34} {sizes[1]:9d} {read:.2f} + {placed:.2f} {both:7.2f}", flush=True)


def main() -> None:
    torch.set_num_threads(asked.threads)
    rng = np.random.default_rng(0)
    t = Tokens(*(rng.random(shape, np.float32) for shape in ((9,), (10,), (asked.objects + 1, 6), (asked.regions, 4))))
    print(f"width {asked.width}, {asked.objects} objects, {asked.regions} regions, {asked.threads} thread(s); ms\n")
    print(f"{'form':8} {'network':34} {'weights':>9} {'numpy':>7} {'torch':>7}")
    for form in ("objects", "paper"):
        measure(form, t)


if __name__ == "__main__":
    main()
