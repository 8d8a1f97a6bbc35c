"""Arithmetic that gives the same bits on every machine.

A motor duty must not depend on the processor, on the C library, or on the release of numpy. Code
that affects a duty therefore avoids BLAS, LAPACK, the C library's elementary functions, ``**`` on
floats and numpy's distributions. The replacements are here. They use additions, multiplications,
divisions and square roots of IEEE double precision, which every machine rounds alike, in a fixed
order.

The functions take and return plain numbers, so that numba can compile them unchanged.
"""
