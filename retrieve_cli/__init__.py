"""The `retrieve` command line: words and files, no algorithm."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
"""Of numpy and scipy, before either is imported: our matrices are small, and more threads only get in their way. PyTorch's are its own."""
