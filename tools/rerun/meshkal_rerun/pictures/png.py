# SPDX-License-Identifier: MIT
"""PNG files and bytes, with a palette and as small as they must be."""

import io
import os
from pathlib import Path

from PIL import Image
from PIL.PngImagePlugin import PngInfo

LARGEST = 240_000


def save(picture: Image.Image, path: Path, title: str = "", description: str = "") -> None:
    """Whole or not at all."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(encoded(picture, title, description))
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def encoded(picture: Image.Image, title: str = "", description: str = "") -> bytes:
    """With as many colours as fit into `LARGEST` bytes, 32 at least."""
    texts = PngInfo()
    for key, text in (("Title", title), ("Description", description)):
        if text:
            texts.add_itxt(key, text)
    for colours in (256, 128, 64, 32):
        out = io.BytesIO()
        paletted = picture.convert("RGB").quantize(colours, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
        paletted.save(out, format="PNG", optimize=True, pnginfo=texts)
        if out.tell() <= LARGEST:
            break
    return out.getvalue()
