"""Arithmetic that gives the same bits on every machine.

A motor duty must not depend on the processor, on the C library, or on the release of numpy. So
nothing that leads to one uses BLAS, LAPACK, the C library's elementary functions, ``**`` on floats
or numpy's distributions. What is needed instead is here: additions, multiplications, divisions and
square roots of IEEE double precision, which every machine rounds alike, in a fixed order.

The functions take and return plain numbers, so that a compiler takes them as they are.
"""
