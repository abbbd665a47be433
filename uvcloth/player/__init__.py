"""The runtime in C++ that plays clothes, as Python calls it: NumPy and the standard library are enough."""
