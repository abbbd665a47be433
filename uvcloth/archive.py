"""npz files, where this floor looks for them."""

from rasterize.archive import load_arrays, save_arrays

__all__ = ["load_arrays", "save_arrays"]
