"""All that rests on numba's inner parts: how functions are compiled, records of arrays, vectors of float32."""
