"""Hashes that tell contents apart: of bodies, garments, sequences and files."""

import hashlib

from torch import Tensor


def fingerprint(*contents: Tensor | str | bytes) -> str:
    """SHA-256 of contents one after another, in hexadecimal: the bytes of tensors, and text as UTF-8.

    Neither shapes nor dtypes count, and where one ends and the next begins only by what they hold.
    """
    digest = hashlib.sha256()
    for content in contents:
        if isinstance(content, Tensor):
            digest.update(content.detach().cpu().contiguous().numpy().tobytes())
        else:
            digest.update(content.encode() if isinstance(content, str) else content)
    return digest.hexdigest()
