# SPDX-License-Identifier: MIT
from platformio.public import PlatformBase


class HerePlatform(PlatformBase):
    """Compilers that are installed already; custom_prefix of an environment names those of a target."""
