"""The `retrieve` command line: words and files, no algorithm."""

import gc
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
"""Of numpy and scipy, before either is imported: our matrices are small, and more threads only get in their way. PyTorch's are its own."""
gc.set_threshold(10_000, *gc.get_threshold()[1:])
"""Planning makes many small objects that last: to look for garbage among them after every 700 is 3 % of its time."""
