"""Sums in one order on any number of threads, so that the same command gives the same bytes."""

import os

MKL_MODE = "AVX2,STRICT"
"""Mode of Intel's MKL, with which torch multiplies matrices on x86: one order of summation, whatever the
number of threads and the place in memory. It costs nothing measurable on AVX2; torch has no such switch."""


def fix_summation_order() -> None:
    """Have matrix products sum in one order in this process and those it starts; before the first product.

    A mode that the environment asks for (MKL_CBWR) stays.
    """
    os.environ.setdefault("MKL_CBWR", MKL_MODE)
