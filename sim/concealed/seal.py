"""The truth of a draw, kept shut until everything has been diagnosed.

The seal is no secret lock: the key is in the file. It keeps the truth from being read by accident or by a glob, and
its SHA-256, printed when the draw is made and again before it is opened, shows that nothing was changed in between.
The truth holds the digest of every campaign, so campaigns can't be exchanged either. Equal truths give equal seals.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import zlib
from pathlib import Path
from typing import Any, Final

from jointscope.atomic import replaced_file
from jointscope.errors import InputError

MAGIC: Final = b"jointscope-sealed-truth/1\n"
NAME: Final = "truth.sealed"
RECEIPT: Final = "seal.sha256"


class SealError(InputError):
    """The sealed truth, or what it vouches for, isn't what it was when it was sealed."""


def seal(truth: dict[str, Any]) -> bytes:
    """The truth as sealed bytes."""
    plain = zlib.compress(json.dumps(truth, sort_keys=True).encode(), 9)
    nonce = hashlib.sha256(b"nonce" + plain).digest()[:16]
    key = hashlib.sha256(MAGIC + nonce).digest()
    hidden = _masked(plain, key)
    return MAGIC + nonce + hmac.new(key, hidden, "sha256").digest() + hidden


def unseal(sealed: bytes, path: Path) -> dict[str, Any]:
    """Open sealed bytes; ``path`` is for messages.

    Raises:
        SealError: Not a seal, or a damaged one.
    """
    if not sealed.startswith(MAGIC):
        raise SealError(
            path, None, "isn't a sealed truth", fix="point at a folder written by 'jointscope conceal'"
        )
    start = len(MAGIC)
    nonce, tag, hidden = sealed[start : start + 16], sealed[start + 16 : start + 48], sealed[start + 48 :]
    key = hashlib.sha256(MAGIC + nonce).digest()
    if not hmac.compare_digest(tag, hmac.new(key, hidden, "sha256").digest()):
        raise SealError(path, None, "was changed after it was sealed", fix="draw again with 'jointscope conceal'")
    opened: dict[str, Any] = json.loads(zlib.decompress(_masked(hidden, key)))
    return opened


def _masked(data: bytes, key: bytes) -> bytes:
    blocks = (hashlib.sha256(key + i.to_bytes(8, "big")).digest() for i in range(len(data) // 32 + 1))
    return bytes(a ^ b for a, b in zip(data, b"".join(blocks), strict=False))


def digest(data: bytes) -> str:
    """SHA-256 as text."""
    return hashlib.sha256(data).hexdigest()


def folder_digest(folder: Path) -> str:
    """SHA-256 over the names and contents of a campaign's files, in the order of their names."""
    total = hashlib.sha256()
    for file in sorted(path for path in folder.rglob("*") if path.is_file()):
        total.update(
            file.relative_to(folder).as_posix().encode() + b"\0" + hashlib.sha256(file.read_bytes()).digest()
        )
    return total.hexdigest()


def write_seal(folder: Path, truth: dict[str, Any]) -> str:
    """Write ``truth.sealed`` and its receipt into ``folder``; the SHA-256."""
    sealed = seal(truth)
    for name, data in ((NAME, sealed), (RECEIPT, f"{digest(sealed)}  {NAME}\n".encode())):
        with replaced_file(folder / name) as temporary:
            temporary.write_bytes(data)
    return digest(sealed)


def sealed_digest(folder: Path) -> str:
    """SHA-256 of the folder's seal, checked against its receipt, without opening it.

    Raises:
        SealError: There is no seal, or it isn't the one that the receipt names.
    """
    path = folder / NAME
    if not path.is_file():
        raise SealError(
            path, None, "is missing", fix="finish the draw with 'jointscope conceal' and the same seed"
        )
    found = digest(path.read_bytes())
    receipt = folder / RECEIPT
    stated = receipt.read_text(encoding="utf-8").split()[0] if receipt.is_file() else ""
    if stated != found:
        raise SealError(receipt, "sha256", f"is not that of {NAME} ({found})", value=stated, fix="draw again")
    return found


def open_seal(folder: Path, expected: str) -> dict[str, Any]:
    """The truth, if its hash is still ``expected``.

    Raises:
        SealError: The seal was exchanged since ``expected`` was taken.
    """
    path = folder / NAME
    data = path.read_bytes()
    if digest(data) != expected:
        raise SealError(path, "sha256", "changed since the diagnosis began", value=digest(data), fix="draw again")
    return unseal(data, path)
