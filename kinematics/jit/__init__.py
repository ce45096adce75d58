"""All that rests on numba's inner parts: how functions are compiled and kept, records of arrays, vectors of float32.

Which parts, and why
--------------------

**`decorators.py`: to start without numba.** Importing numba takes 0.3 s, getting it ready as much again, and loading sixty functions from
its cache a second. So a decorated function is a description, and numba is imported when something has to be compiled.

**`pipeline.py` and `compiler.py`: to compile the core once.** numba emits machine code for every compiled function together with all that
it calls, so that a function deep down is emitted once more in each of its callers, all the way up. The core is some hundred functions deep.
`jit_inline` stops a function at LLVM's intermediate form; so does `jit_entry`, and what Python calls is emitted, whole, once. This takes
from numba what it does not promise to keep:

- `JITCodeLibrary`, of which three private methods are replaced: optimise not at every level, emit nothing, keep bitcode in the cache; and
  two more are used to link and optimise what is emitted;
- `Compiler.define_pipelines`, `LoweringPass`, `register_pass`, and in the pass `_dynfunc.make_function` and
  `targetctx.insert_user_function`, which tell callers about a function that has no address;
- the dispatchers' `get_call_template`, so that a function is not compiled anew for every number that is written out where it is called, and
  `compile`;
- the option `_nrt=False`, which leaves out reference counts: the core makes no array, and a query consists of dozens of them.

**`trampoline.py` and `machine_code.py`: to call it.** Machine code is kept in files of our own and loaded with llvmlite's documented parts.
The way in is ours too, since numba's own needs numba: a builtin function, in LLVM's form, that takes its arguments apart by numpy's ABI. It
calls what numba compiled by `call_conv.call_function`. It takes as long as numba's, 0.4 µs for four arguments. `numpy_abi.py` says where
arrays and dtypes have what, `builtin.py` has what is the same for all builtin functions. `record_table.py` is one more of them: it writes
what compiled code is handed of a record, in 2 µs instead of 12.

**`ship.py` and `shipped.py`: to compile before the first run.** What the entries of the core come to, in LLVM's optimised form, ships with
the package: a first run makes machine code of it for its own CPU, in 4 s instead of 50, by llvmlite's documented parts and without numba.
Functions that several entries need are there once. `fingerprint.py` says of what version each entry is: the text of all that it calls, and
the constants and record fields that it reads; an entry of which one of them has changed is compiled as if nothing shipped. So is all of it
on another system than x86-64 Linux, with an older LLVM, or with settings of numba's.

**`cache_files.py`: to keep what numba keeps with a checksum.** `IndexDataCacheFile` and four of its private methods, found by way of a
dispatcher's `_cache`.

**`record.py` and `record_type.py`: to hand on fifty arrays as one pointer.** As an ordinary named tuple numba passes them as four hundred
arguments at every call. A record is a type of our own, by the documented low-level extension API (`register_model`,
`lower_getattr_generic`, `unbox`, `typeof_impl`), by `infer_getattr` beside it, and by the target context's `make_array` and
`populate_array`. Where an array's numbers are is read from numpy's ABI, not from numba.

**`simd.py` and `simd_lowering.py`: sixteen float32 at once.** numba has no vector type; this one is a type of our own with intrinsics that
emit LLVM's instructions, again by the extension API (`intrinsic`, `register_model`, `lower_builtin`) and by `infer_global`.

Without them
------------

The first four groups can go wrong silently with a numba that nobody tried. So they are used only with versions whose parts were shown to
work by the tests (`support.SHOWN`), and only if all of them are there. Otherwise, and when `RETRIEVE_PLAIN_NUMBA=1` asks for it, both
decorators are plain `njit`, one line on stderr says why, and everything runs as before, to the same numbers. Measured on one problem of
RRT-Connect and shortcuts (CPU seconds from nothing, and one query afterwards; numba 0.68.1):

| how | compiling | query |
|---|---|---|
| by the inner parts | 21 s | 0.34 ms |
| plain `njit` | 42 s | 0.39 ms |
| plain `njit(inline="always")` | 137 s, and not cached | 0.32 ms |
| plain `njit`, and records as ordinary named tuples | 63 s | 1.44 ms |

`inline="always"` copies functions before their types are known and infers the whole anew at each entry; so the fallback does not use it.

The others have no fallback: they rest on an interface that numba documents and has kept since 2018, a change would be an
exception at the first import or compilation and not a wrong number, and pyproject.toml says `numba<1`.
"""

from kinematics.jit import cache_folder as cache_folder  # before numba is imported
