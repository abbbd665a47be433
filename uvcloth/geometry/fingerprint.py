"""Hashes of the contents of bodies, garments, sequences and files."""

import hashlib

from torch import Tensor


def fingerprint(*contents: Tensor | str | bytes) -> str:
    """SHA-256 of contents one after another, in hexadecimal: the bytes of tensors, and text as UTF-8.

    Only the bytes count: shapes, dtypes and borders between contents do not change the hash.
    """
    digest = hashlib.sha256()
    for content in contents:
        if isinstance(content, Tensor):
            digest.update(content.detach().cpu().contiguous().numpy().tobytes())
        else:
            digest.update(content.encode() if isinstance(content, str) else content)
    return digest.hexdigest()
