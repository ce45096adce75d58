"""All that rests on numba's inner parts: how functions are compiled and kept, records of arrays, vectors of float32."""

from kinematics.jit import cache_folder as cache_folder  # before numba is imported
